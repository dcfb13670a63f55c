// Stand-in for ros2_control's header: as much as docs/ros2.md uses, with the same signatures.
#pragma once
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace rclcpp
{
struct Time {};
struct Duration {};
struct SystemDefaultsQoS {};
struct Logger {};
template <class Message>
struct Subscription
{
  using SharedPtr = std::shared_ptr<Subscription>;
  std::function<void(std::shared_ptr<Message>)> call;
};
}  // namespace rclcpp
namespace rclcpp_lifecycle
{
struct State {};
}  // namespace rclcpp_lifecycle

#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::fprintf(stderr, __VA_ARGS__), std::fputc(10, stderr))
#define RCLCPP_WARN RCLCPP_ERROR

namespace hardware_interface
{
class LoanedStateInterface
{
public:
  explicit LoanedStateInterface(std::optional<double> * value) : value_(value) {}
  std::optional<double> get_optional() const { return *value_; }

private:
  std::optional<double> * value_;
};
class LoanedCommandInterface
{
public:
  explicit LoanedCommandInterface(double * value) : value_(value) {}
  [[nodiscard]] bool set_value(double value)
  {
    *value_ = value;
    return true;
  }

private:
  double * value_;
};
}  // namespace hardware_interface

namespace controller_interface
{
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names;
};

struct Parameter
{
  std::vector<std::string> strings;
  std::string string;
  std::vector<std::string> as_string_array() const { return strings; }
  std::string as_string() const { return string; }
};

struct Node
{
  std::map<std::string, Parameter> parameters;
  std::function<void(const std::vector<double> &)> publish;  // for whoever plays the manager
  Parameter get_parameter(const std::string & name) const { return parameters.at(name); }
  rclcpp::Logger get_logger() const { return {}; }
  template <class Message, class Qos, class Callback>
  typename rclcpp::Subscription<Message>::SharedPtr create_subscription(
    const std::string &, Qos, Callback callback)
  {
    publish = [callback](const std::vector<double> & data) {
      auto message = std::make_shared<Message>();
      message->data = data;
      callback(message);
    };
    auto made = std::make_shared<rclcpp::Subscription<Message>>();
    made->call = callback;
    return made;
  }
};

class ControllerInterface
{
public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) = 0;
  virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;

  std::shared_ptr<Node> get_node() { return node_; }
  std::shared_ptr<const Node> get_node() const { return node_; }
  unsigned int get_update_rate() const { return update_rate_; }
  template <class Value>
  void auto_declare(const std::string & name, const Value &)
  {
    node_->parameters[name];
  }

  // What the manager does.
  unsigned int update_rate_ = 0;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;

private:
  std::shared_ptr<Node> node_ = std::make_shared<Node>();
};
}  // namespace controller_interface
