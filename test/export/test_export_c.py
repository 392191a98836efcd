"""Exported C against the Python kernels: compiled strictly, run under sanitizers, for each law and effect at 1 and 20 kHz."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from export_axes import axis, effect_of, every

from tcs_friction.control.model_compensator import CancellationConfig
from tcs_friction.export import c
from tcs_friction.export.code import identifier, plain
from tcs_friction.export.request import Request
from tcs_friction.physics.axis import Axis, Drive

COMPILER, PLUS = shutil.which("cc") or "", shutil.which("c++") or ""
needs_compiler = pytest.mark.skipif(not (COMPILER and PLUS), reason="no C and C++ compiler here")
STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic")
SANITIZED = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def exported(folder: Path, of: Axis, period: float = 1e-3, **changes: object) -> dict[str, str]:
    request = Request(of, Path("axis.yaml"), folder / "made.c", joint="joint 1", period=period, speed=0.5, **changes)  # type: ignore[arg-type]
    files = c.export(request).files
    for path, text in files.items():
        assert isinstance(text, str)
        path.write_text(text)
    return {path.name: str(text) for path, text in files.items()}


def ran(folder: Path, *flags: str) -> tuple[int, str]:
    """What the exported main says, compiled with these flags."""
    built = [COMPILER, "-std=c99", *STRICT, *flags, "made.c", "made_test.c", "-lm", "-o", "made"]
    subprocess.run(built, cwd=folder, check=True, timeout=100)
    done = subprocess.run(["./made"], cwd=folder, capture_output=True, text=True, check=False, timeout=100)
    return done.returncode, done.stdout + done.stderr


@needs_compiler
@pytest.mark.parametrize("name", every())
def test_code_computes_what_the_kernels_do(name: str, tmp_path: Path) -> None:
    for period in (1e-3, 5e-5):
        exported(tmp_path, every()[name], period)
        assert ran(tmp_path, *SANITIZED)[0] == 0, "double: 1e-9 of the largest"
        assert ran(tmp_path, "-O2", "-DMADE_FLOAT")[0] == 0, "float: 1e-4 of the largest"


@needs_compiler
def test_a_main_that_is_told_something_else_fails(tmp_path: Path) -> None:
    exported(tmp_path, axis("lugre", "cogging"))
    (tmp_path / "made.c").write_text((tmp_path / "made.c").read_text().replace("REAL(60.0)", "REAL(60.001)"))
    code, told = ran(tmp_path, "-O1")
    assert code > 0
    assert "too much" in told


@needs_compiler
def test_share_rest_band_and_limits_are_those_of_the_compensator(tmp_path: Path) -> None:
    config = CancellationConfig(
        share=0.7, rest_speed=0.1, rest_torque=5.0, total_limit=40.0, entry_time=0.0, effect_limit=8.0
    )
    exported(tmp_path, axis("lugre", "cogging", "coulomb_asymmetry", "torque_ripple"), compensation=config)
    assert ran(tmp_path, *SANITIZED)[0] == 0


@needs_compiler
def test_an_effect_that_is_switched_off_leaves_slowly(tmp_path: Path) -> None:
    exported(tmp_path, axis("coulomb_viscous", "torque_bias"), compensation=CancellationConfig(entry_time=0.1))
    (tmp_path / "made_test.c").write_text("""#include "made.h"
int main(void) {
    made_compensator c; int k; double before, now, largest = 0.0;
    made_compensator_start(&c);
    before = made_compensator_step(&c, 0.0, 0.0, 0.0, 0.0, 20.0);
    if (before != 12.0) { return 1; }
    c.wanted[1] = 0.0;
    for (k = 0; k < 120; k++) {
        now = made_compensator_step(&c, 1e-3 * k, 0.0, 0.0, 0.0, 20.0);
        largest = (before - now > largest) ? before - now : largest;
        before = now;
    }
    return (before == 0.0 && largest < 0.1201) ? 0 : 2;
}
""")
    assert ran(tmp_path, *SANITIZED)[0] == 0, "12 N m in 100 periods"


STUBS = {
    "controller_interface/chainable_controller_interface.hpp": """#pragma once
#include <memory>
#include <string>
#include <vector>
namespace rclcpp { struct Time { double seconds() const { return 0.0; } }; struct Duration {}; }
namespace rclcpp_lifecycle { struct State {}; }
namespace hardware_interface {
struct CommandInterface {
    CommandInterface(const std::string &, const std::string &, double * value) : value_(value) {}
    bool set_value(double value) { *value_ = value; return true; }
    double * value_;
};
}
namespace controller_interface {
enum class CallbackReturn { SUCCESS, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };
struct InterfaceConfiguration { interface_configuration_type type; std::vector<std::string> names; };
struct Node { std::string get_name() const { return "node"; } };
class ChainableControllerInterface {
public:
    virtual ~ChainableControllerInterface() = default;
    virtual CallbackReturn on_init() = 0;
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) { return CallbackReturn::SUCCESS; }
    std::vector<hardware_interface::CommandInterface> command_interfaces_;
    std::vector<double> reference_interfaces_;
    std::shared_ptr<Node> get_node() { return std::make_shared<Node>(); }
    return_type turn() { return update_and_write_commands(rclcpp::Time(), rclcpp::Duration()); }
    std::vector<hardware_interface::CommandInterface> interfaces() { return on_export_reference_interfaces(); }
protected:
    virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
    virtual return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) = 0;
    virtual return_type update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration &) = 0;
};
}
""",
    "pluginlib/class_list_macros.hpp": "#pragma once\n#define PLUGINLIB_EXPORT_CLASS(a, b) static_assert(true);\n",
}
DRIVEN = """#include "made_controller.cpp"
#include <cstdio>
int main() {
    double effort = 0.0;
    made::CompensatingController controller;
    made::Axis<float> single;
    made_none();
    if (controller.interfaces().size() != 4) { return 1; }
    controller.command_interfaces_.emplace_back("joint 1", "effort", &effort);
    controller.on_activate(rclcpp_lifecycle::State());
    controller.reference_interfaces_ = {0.0, 0.5, 0.0, 3.0};
    for (int k = 0; k < 200; ++k) { if (controller.turn() != controller_interface::return_type::OK) { return 2; } }
    std::printf("%.9f %.6f\\n", effort, static_cast<double>(single.compensate(0.f, 0.f, 0.f, 0.f)));
    return 0;
}
""".replace("    made_none();\n", "")


@needs_compiler
def test_the_class_and_its_controller_compile_and_compensate(tmp_path: Path) -> None:
    exported(tmp_path, axis("lugre"))
    for name, text in STUBS.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "driven.cpp").write_text(DRIVEN)
    subprocess.run(
        [PLUS, "-std=c++17", *STRICT, *SANITIZED, "-I.", "driven.cpp", "-o", "driven"], cwd=tmp_path, check=True, timeout=200
    )
    done = subprocess.run(["./driven"], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=100)
    effort, single = map(float, done.stdout.split())
    assert effort == pytest.approx(3.0 + 60.0 + 50.0 * 0.5, rel=1e-6)
    assert single == 0.0


def test_code_has_neither_heap_nor_globals_that_change(tmp_path: Path) -> None:
    text = exported(tmp_path, axis("lugre", "cogging", "flexible_mode"))["made.c"]
    assert not re.search(r"\b(malloc|calloc|free|goto)\b", text)
    outside = [line for line in text.splitlines() if line and not line[0].isspace()]
    variables = [line for line in outside if " = " in line]
    assert variables
    assert all(line.startswith("static const ") for line in variables)


def test_what_the_compensator_lacks_is_said(tmp_path: Path) -> None:
    of = replace(axis("lugre", "backlash", "encoder_periodic_error", "wind_torque", "temperature_dependent_friction"),
                 drive=Drive(noise=1.0))  # fmt: skip
    lines = "\n".join(c.export(Request(of, Path("a.yaml"), tmp_path / "x.c", joint="j")).lines)
    for words in (
        "backlash: not in the compensator",
        "encoder periodic error of order 300: not in the compensator",
        "wants wind_speed",
        "wants temperature",
        "noise and resolution",
    ):
        assert words in lines


@pytest.mark.parametrize(
    ("text", "expected"), [("Joint 1-left", "joint_1_left"), ("1st", "axis_1st"), ("*", "axis"), ("ä", "axis")]
)
def test_a_name_is_one_of_c(text: str, expected: str) -> None:
    assert identifier(text) == expected


def test_a_name_ends_no_comment(tmp_path: Path) -> None:
    assert "*/" not in plain("a */ int main(void) { /*")
    of = replace(axis("lugre"), name='evil */ #include "x"\n')
    assert "*/ #include" not in exported(tmp_path, of)["made.h"]
    assert effect_of("cogging").words == "cogging of order 24"
