// Plays the controller manager: configures, activates, updates, deactivates, and once more.
// Reads rows of (6 reference, 4 measurement) numbers from standard input, prints commands.
#include <type_traits>
#include "adaptive_controller.cpp"

#include <cstdlib>
#include <iostream>

using namespace controller_interface;

int main(int argc, char ** argv)
{
  const std::string state_file = argc > 1 ? argv[1] : "";
  const rclcpp_lifecycle::State state;
  adaptive_controller::AdaptiveController controller;
  controller.on_init();
  auto node = controller.get_node();
  node->parameters["joints"].strings = {"joint_1", "joint_2"};
  node->parameters["state_file"].string = state_file;
  controller.update_rate_ = 500;
  if (controller.on_configure(state) != CallbackReturn::FAILURE) return 2;
  controller.update_rate_ = 1000;
  if (controller.on_configure(state) != CallbackReturn::SUCCESS) return 3;
  const auto wanted = controller.state_interface_configuration().names;
  if (wanted != std::vector<std::string>{
        "joint_1/position", "joint_2/position", "joint_1/velocity", "joint_2/velocity"}) return 4;
  if (controller.command_interface_configuration().names[1] != "joint_2/effort") return 5;

  std::vector<std::optional<double>> seen(4);
  std::vector<double> torque(2);
  for (auto & value : seen) controller.state_interfaces_.emplace_back(&value);
  for (auto & value : torque) controller.command_interfaces_.emplace_back(&value);
  if (controller.on_activate(state) != CallbackReturn::ERROR) return 6;  // nothing measured yet

  std::vector<double> row(10);
  bool active = false;
  std::cout.precision(17);
  while (std::cin >> row[0]) {
    for (std::size_t i = 1; i < row.size(); ++i) std::cin >> row[i];
    for (int i = 0; i < 4; ++i) seen[i] = row[6 + i];
    if (!active && controller.on_activate(state) != CallbackReturn::SUCCESS) return 7;
    active = true;
    node->publish(std::vector<double>(row.begin(), row.begin() + 6));
    if (controller.update({}, {}) != return_type::OK) return 8;
    std::cout << torque[0] << " " << torque[1] << "\n";
  }
  const auto last = torque;
  seen[0] = std::nullopt;  // a measurement is lost: the command holds, then it is an error
  for (int i = 0; i < 5; ++i)
    if (controller.update({}, {}) != return_type::OK || torque != last) return 9;
  if (controller.update({}, {}) != return_type::ERROR) return 10;
  return controller.on_deactivate(state) == CallbackReturn::SUCCESS ? 0 : 11;
}
