// Stand-in: the class is found by the file that includes it.
#pragma once
#define PLUGINLIB_EXPORT_CLASS(Class, Base) static_assert(std::is_base_of_v<Base, Class>);
