"""The C code of an axis as a header-only C++17 class, and a chainable controller of ros2_control that uses it."""

from __future__ import annotations

import re

from tcs_friction.export.code import AxisCode, plain


def header(code: AxisCode) -> str:
    """A class template over the number type, with the functions of the C file inside it."""
    text = re.sub(r"MATH\((\w+)\)", r"std::\1", f"{code.structures()}\n\n{code.body()}").replace("REAL(", "real(")
    text = re.sub(r"^static const real", "static constexpr real", text, flags=re.MULTILINE)
    text = re.sub(r"^(void|real) ", r"static \1 ", text, flags=re.MULTILINE)
    inside = "\n".join(f"    {line}" if line else "" for line in text.splitlines())
    name, given = code.name, code.given if code.signals else f"{code.given} = real(20.0)"
    passed = ", signals" if code.signals else ""
    return f"""// {plain(code.axis.name)}: friction and its compensation, for periods of {code.period:g} s. Made by tcs-friction.
#pragma once

#include <cmath>

namespace {name}
{{

template <typename real>
class Axis
{{
public:
    Axis() {{ reset(); }}

    // Bristles at rest, settings as exported.
    void reset()
    {{
        {name}_friction_start(&friction_);
        {name}_compensator_start(&compensator);
    }}

    // Opposing torque of friction and effects at the next instant of a motion.
    real friction(real t, real position, real velocity, real acceleration, real torque, {given})
    {{
        return {name}_friction_step(&friction_, t, position, velocity, acceleration, torque, temperature{passed});
    }}

    // Torque to add to the command, for a reference now.
    real compensate(real t, real position, real velocity, real acceleration, {given})
    {{
        return {name}_compensator_step(&compensator, t, position, velocity, acceleration, temperature{passed});
    }}

private:
{inside}

    {name}_friction friction_;

public:
    {name}_compensator compensator;  // its settings may be changed between two steps
}};

}}  // namespace {name}
"""


def controller(code: AxisCode, joint: str) -> str:
    """The example: it takes a reference motion and an effort, and hands on that effort with the compensation added."""
    name, joint, named = code.name, plain(joint), plain(", ".join(code.signals))
    signals = f"\n    real_t signals[{2 * len(code.signals)}] = {{}};  // {named}: fill them in" if named else ""
    passed = ", 20.0, signals" if code.signals else ""
    return f"""// Chainable controller of ros2_control (Jazzy): effort + compensation of joint {joint}. Made by tcs-friction.
// A controller before it writes the reference interfaces position, velocity, acceleration and effort.
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "{name}.hpp"

namespace {name}
{{

using real_t = double;
using controller_interface::CallbackReturn;

class CompensatingController : public controller_interface::ChainableControllerInterface
{{
public:
    CallbackReturn on_init() override {{ return CallbackReturn::SUCCESS; }}

    controller_interface::InterfaceConfiguration command_interface_configuration() const override
    {{
        return {{controller_interface::interface_configuration_type::INDIVIDUAL, {{"{joint}/effort"}}}};
    }}

    controller_interface::InterfaceConfiguration state_interface_configuration() const override
    {{
        return {{controller_interface::interface_configuration_type::NONE, {{}}}};
    }}

    CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
    {{
        axis_.reset();
        reference_interfaces_.assign(4, 0.0);
        return CallbackReturn::SUCCESS;
    }}

protected:
    std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override
    {{
        const std::vector<std::string> names = {{"position", "velocity", "acceleration", "effort"}};
        std::vector<hardware_interface::CommandInterface> exported;
        reference_interfaces_.assign(names.size(), 0.0);
        for (std::size_t k = 0; k < names.size(); ++k) {{
            exported.emplace_back(get_node()->get_name(), "{joint}/" + names[k], &reference_interfaces_[k]);
        }}
        return exported;
    }}

    controller_interface::return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) override
    {{
        return controller_interface::return_type::OK;
    }}

    controller_interface::return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration &) override
    {{
        const auto & r = reference_interfaces_;{signals}
        const real_t torque = r[3] + axis_.compensate(time.seconds(), r[0], r[1], r[2]{passed});
        if (!std::isfinite(torque)) {{ return controller_interface::return_type::ERROR; }}
        return command_interfaces_[0].set_value(torque) ? controller_interface::return_type::OK
                                                        : controller_interface::return_type::ERROR;
    }}

private:
    Axis<real_t> axis_;  // made for updates every {code.period:g} s
}};

}}  // namespace {name}

#include "pluginlib/class_list_macros.hpp"
PLUGINLIB_EXPORT_CLASS({name}::CompensatingController, controller_interface::ChainableControllerInterface)
"""
