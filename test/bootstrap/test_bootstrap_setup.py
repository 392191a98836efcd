"""./tcs: what it decides, what it says when something is missing, and that it does nothing twice."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
STUB = "import sys; print(sys.path.count('{root}'), *sys.argv[1:]); sys.exit(7)\n"


def load(script: Path) -> ModuleType:
    loader = importlib.machinery.SourceFileLoader("tcs_bootstrap", str(script))
    spec = importlib.util.spec_from_loader("tcs_bootstrap", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout with a virtual environment and no workspace; its command line exits with 7."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for name in ("ROS_DISTRO", "CC", "CXX"):
        monkeypatch.delenv(name, raising=False)
    root = tmp_path / "checkout"
    root.mkdir()
    for name in ("tcs", "setup.py", "setup.cfg", "package.xml"):
        shutil.copy(ROOT / name, root / name)
    for name in ("requirements", "msg_defs", "resource", "bin"):
        shutil.copytree(ROOT / name, root / name)
    (root / "tcs_friction").mkdir()
    (root / "tcs_friction/__init__.py").touch()
    (root / "tcs_friction/cli.py").write_text(STUB.format(root=root))
    python = root / ".tcs/venv/bin/python"
    python.parent.mkdir(parents=True)
    python.symlink_to(sys.executable)
    (root / ".tcs/venv/packages.stamp").write_text(load(root / "tcs").packages_fingerprint())
    return root


def run(checkout: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    tools = checkout / "tools"
    tools.mkdir(exist_ok=True)
    env = {"PATH": str(tools), "HOME": str(checkout), "PYTHONDONTWRITEBYTECODE": "1", **variables}
    command = [sys.executable, str(checkout / "tcs"), *arguments]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)


def make_environment(checkout: Path) -> Path:
    """Writes the record of a finished set-up."""
    module = load(checkout / "tcs")
    environment = module.describe_environment()
    environment["fingerprint"] = module.workspace_fingerprint()
    record = checkout / ".tcs/environment.json"
    record.write_text(json.dumps(environment))
    return record


def snapshot(folder: Path) -> dict[str, int]:
    return {str(path): path.lstat().st_mtime_ns for path in folder.rglob("*")}


def test_the_environments_own_python_is_left_before_it_may_be_deleted(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bootstrap, called = load(checkout / "tcs"), []
    monkeypatch.setattr(os, "execv", lambda *arguments: called.append(arguments))
    monkeypatch.setattr(sys, "_base_executable", "/usr/bin/base")
    bootstrap.use_supported_python()
    assert not called
    monkeypatch.setattr(sys, "prefix", str(checkout / ".tcs/venv"))
    bootstrap.use_supported_python()
    assert called[0] == ("/usr/bin/base", ["/usr/bin/base", str(checkout / "tcs"), *sys.argv[1:]])


def alive(process: int) -> bool:
    """Whether a process runs, and is not one that waits to be collected."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_node_command_names_missing_compiler(checkout: Path) -> None:
    result = run(checkout, "demo")
    assert result.returncode == 1
    assert result.stdout == ""
    message = "tcs: no C compiler: install one (Debian, Ubuntu: build-essential)\n"
    assert result.stderr == message


def test_an_interrupt_waits_for_the_command_to_hear_it(checkout: Path) -> None:
    """Python itself would answer it with a traceback while it starts."""
    make_environment(checkout)
    probe = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))\n"
    (checkout / "tcs_friction/cli.py").write_text(probe)
    assert run(checkout, "identify").stdout == "True\n"


def test_missing_cxx_compiler_is_told_from_missing_c_compiler(checkout: Path) -> None:
    (checkout / "tools").mkdir()
    (checkout / "tools/cc").symlink_to("/bin/true")
    assert "no C++ compiler" in run(checkout, "demo").stderr


def test_analysis_command_goes_on_without_compiler(checkout: Path) -> None:
    result = run(checkout, "identify", "bag")
    assert result.returncode == 7
    assert result.stdout == "1 identify bag\n"
    assert result.stderr.count("\n") == 1
    assert "going on without ROS 2" in result.stderr


def test_second_run_does_nothing_and_passes_the_exit_status(checkout: Path) -> None:
    make_environment(checkout)
    before = snapshot(checkout)
    result = run(checkout, "demo", "-o", "out")
    assert (result.returncode, result.stdout, result.stderr) == (7, "1 demo -o out\n", "")
    after = snapshot(checkout)
    assert {name: after[name] for name in before} == before
    assert {Path(name).name for name in after.keys() - before.keys()} <= {"tools"}


def test_changed_message_makes_the_set_up_run_again(checkout: Path) -> None:
    make_environment(checkout)
    with (checkout / "msg_defs/msg/AxisTorque.msg").open("a") as message:
        message.write("float64 more\n")
    assert "no C compiler" in run(checkout, "demo").stderr


def test_broken_record_makes_the_set_up_run_again(checkout: Path) -> None:
    make_environment(checkout).write_text('{"python": ')
    assert "no C compiler" in run(checkout, "demo").stderr


def test_each_python_keeps_an_environment_of_its_own(checkout: Path) -> None:
    """The first has its place as ever; another one in between takes nothing away."""
    assert checkout / ".tcs" == load(checkout / "tcs").HOME
    (checkout / ".tcs/venv/lib/python3.4").mkdir(parents=True)
    other = load(checkout / "tcs")
    assert checkout / ".tcs/python{}.{}".format(*sys.version_info) == other.HOME
    assert other.VENV.parent == other.ENVIRONMENT.parent == other.HOME
    (checkout / ".tcs/venv/lib/python3.4").rename(checkout / f".tcs/venv/lib/{other.HOME.name}")
    assert checkout / ".tcs" == load(checkout / "tcs").HOME


def test_moved_checkout_makes_its_own_environment(checkout: Path) -> None:
    make_environment(checkout)
    moved = checkout.rename(checkout.with_name("moved"))
    assert load(moved / "tcs").read_environment() == {}


def test_fingerprint_follows_packaging_and_not_sources(checkout: Path) -> None:
    module = load(checkout / "tcs")
    first = module.workspace_fingerprint()
    (checkout / "tcs_friction/new.py").write_text("pass\n")
    assert module.workspace_fingerprint() == first
    (checkout / "config").mkdir()
    (checkout / "config/axis.yaml").write_text("a")
    second = module.workspace_fingerprint()
    assert second != first
    (checkout / "config/axis.yaml").write_text("b")
    assert module.workspace_fingerprint() == second
    (checkout / "requirements/locked/core.txt").write_text("numpy\n")
    assert module.workspace_fingerprint() != second


def test_unsupported_python_is_named(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = load(checkout / "tcs")
    monkeypatch.setattr(module.sys, "version_info", (3, 9, 2))
    monkeypatch.setattr(module.shutil, "which", lambda _: None)
    with pytest.raises(module.SetupError, match=r"Python 3\.11 to 3\.13 is needed, and python3 is 3\.9 here"):
        module.use_supported_python()


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("ERROR: Could not find a version (from versions: none)\nERROR: No matching", "no network: "),
        (
            "warning: x\nCMake Error at CMakeLists.txt:4\nmore",
            "build failed: CMake Error at CMakeLists.txt:4",
        ),
        ("No space left on device", "build failed: No space left on device"),
        ("", "build failed: no output"),
    ],
)
def test_failed_command_is_explained_in_one_line(output: str, message: str) -> None:
    line = load(ROOT / "tcs").explain("build", output)
    assert line.startswith(message)
    assert "\n" not in line
    assert "setup.log" in line


@pytest.mark.parametrize(("distribution", "found"), [("jazzy", True), ("humble", False)])
def test_only_jazzy_is_used_when_sourced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, distribution: str, found: bool
) -> None:
    (tmp_path / "share/rclpy").mkdir(parents=True)
    (tmp_path / "share/rclpy/package.xml").touch()
    module = load(ROOT / "tcs")
    own = str(module.INSTALL / "tcs_friction")
    monkeypatch.setenv("ROS_DISTRO", distribution)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{own}:{tmp_path}")
    monkeypatch.setenv("PYTHONPATH", "/ros/site-packages")
    assert module.sourced_prefixes() == ([str(tmp_path)] if found else [])
    assert ("PYTHONPATH" in module.clean_environment()) is found


def test_applying_the_environment_twice_changes_nothing_more(checkout: Path) -> None:
    module = load(checkout / "tcs")
    environment: dict[str, Any] = module.describe_environment()
    once = module.apply_environment(environment, {"PATH": "/bin"})
    assert once["PATH"].endswith(":/bin")
    assert once["PYTHONPATH"].split(":")[0] == str(checkout)
    assert module.apply_environment(environment, once) == once


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_whatever_ends_the_set_up_ends_its_children_and_leaves_no_record(number: signal.Signals, checkout: Path) -> None:
    """Also those that a build tool has started, each in a process group of its own as ninja does."""
    slow = checkout / "slow.py"
    pid_file = checkout / "pid"
    program = "import os, subprocess as s; p = s.Popen(['sleep', '60'], process_group=0)\n"
    program += f"open({str(pid_file)!r}, 'w').write(f'{{os.getpid()}} {{p.pid}}\\n'); p.wait()"
    command = [sys.executable, "-c", program]
    slow.write_text(
        "import os, runpy, signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a background job ignores it, a terminal's does not
        f"tcs = runpy.run_path({str(checkout / 'tcs')!r})\n"
        "tcs['end_on_signals']()\n"
        f"tcs['run_stage'](1, 'slow', {command!r}, dict(os.environ))\n"
    )
    child = subprocess.Popen([sys.executable, str(slow)], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 20.0
    while not (pid_file.exists() and pid_file.read_text().endswith("\n")) and time.monotonic() < deadline:
        time.sleep(0.01)
    child.send_signal(number)
    orderly = number in (signal.SIGTERM, signal.SIGHUP)
    assert child.wait(timeout=20) == (128 + number if orderly else -number)
    left = [int(word) for word in pid_file.read_text().split()]
    assert len(left) == 2
    while time.monotonic() < deadline and any(map(alive, left)):
        time.sleep(0.01)
    assert not any(map(alive, left))
    assert not (checkout / ".tcs/environment.json").exists()


@pytest.mark.parametrize(
    ("words", "groups"),
    [
        (["bench", "identify"], "bench"),
        (["bench"], "bench live fleet"),
        (["node", "dynamometer", "--ros-args"], "hardware"),
        (["node", "canopen_drive"], "canopen"),
        (["bench", "canopen", "--serve", "29536"], "canopen"),
        (["node", "mujoco_plant", "--ros-args", "-p", "period:=0.002"], "mujoco"),
        (["graph", "my.yaml", "--plant", "mujoco", "--joint", "elbow"], "mujoco"),
        (["simulate", "my.yaml", "--plant=mujoco"], "mujoco"),
        (["diagnose", "bag", "--axis", "my.yaml", "--against", "my.XML"], "mujoco"),
        (["compare", "bag", "--axis", "my.yaml", "--with", "other.bag", "--with=my.xml"], "mujoco"),
        (["export", "my.yaml", "--to", "mjcf", "-o", "out.xml"], "mujoco"),
        (["live", "my.yaml", "--port", "9000"], "live"),
        (["graph", "my.yaml", "--live"], "live"),
        (["graph", "my.yaml", "--plant", "mujoco", "--live"], "live mujoco"),
        (["test", "test/physics"], "test_optional"),
        (["fleet", "bags", "--axes", "axes.yaml"], "fleet"),
        (["bench", "fleet"], "fleet"),
        (["bench", "hostile", "--kind", "writing"], "live"),
    ],
)
def test_optional_sets_are_installed_once(
    words: list[str], groups: str, checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = load(checkout / "tcs")
    calls: list[str] = []

    def offline(_: int, title: str, *__: object) -> None:
        calls.append(title)
        raise module.SetupError("no network")

    monkeypatch.setattr(module, "run_stage", offline)
    module.install_optional(words)
    assert "no network; going on without" in capsys.readouterr().err
    for group in groups.split():
        (checkout / f".tcs/venv/{group}.stamp").write_text(module.packages_fingerprint())
    module.install_optional(words)
    for others in ("identify bag", "diagnose bag --against other.bag", "graph my.yaml --plant simulated"):
        module.install_optional(others.split())
    assert len(calls) == len(groups.split())


def test_a_set_up_that_was_interrupted_goes_on_from_the_stage(
    checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C in each stage in turn: what was finished before is not made again, what was half made is."""
    module = load(checkout / "tcs")
    (checkout / ".tcs/venv/packages.stamp").unlink()
    monkeypatch.setattr(module, "check_compilers", lambda: None)
    stages: list[int] = []
    half_made = [module.HOME / "build/half", module.INSTALL / "half"]

    def interrupted(number: int, *_: object) -> None:
        stages.append(number)
        if number == 4:
            for folder in half_made:
                assert not folder.exists() or stages.count(4) == 1
                folder.mkdir(parents=True, exist_ok=True)
        module.VENV.mkdir(parents=True, exist_ok=True)
        if stages.count(number) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "run_stage", interrupted)
    for _ in range(4):
        with pytest.raises(KeyboardInterrupt):
            module.set_up("demo")
    module.set_up("demo")
    assert stages == [1, 1, 1, 2, 2, 3, 3, 4, 4]  # stage 1 is two commands
    assert module.ENVIRONMENT.exists()


def test_the_package_in_whose_middle_pip_was_ended_is_installed_again(checkout: Path) -> None:
    module = load(checkout / "tcs")
    packages = checkout / ".tcs/venv/lib/python3.11/site-packages"
    for name, files in (("whole", ("METADATA", "INSTALLER")), ("half", ("METADATA",))):
        (packages / f"{name}-1.dist-info").mkdir(parents=True)
        for file in files:
            (packages / f"{name}-1.dist-info" / file).touch()
    module.drop_half_installed()
    assert [path.name for path in packages.iterdir()] == ["whole-1.dist-info"]


def pins(path: Path) -> dict[str, list[str]]:
    """Each package of a lock file, `name==version`, with its hashes."""
    found: dict[str, list[str]] = {}
    for line in path.read_text().splitlines():
        if not line.startswith(("#", " ")):
            found[line.split()[0]] = []
        elif "--hash" in line:
            found[list(found)[-1]].append(line.strip().removesuffix(" \\").removeprefix("--hash=sha256:"))
    return found


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_package_that_is_wanted_is_pinned_with_hashes() -> None:
    """Each requirements/NAME.txt has its lock file; `.ci/supply lock` makes them."""
    folder = ROOT / "requirements"
    known = {line.split()[0] for line in (folder / "constraints.txt").read_text().splitlines() if "==" in line}
    sets = {path.name for path in folder.glob("*.txt")} - {"constraints.txt"}
    assert sets == {path.name for path in (folder / "locked").glob("*.txt")}
    for name in sets:
        locked = pins(folder / "locked" / name)
        assert set(locked) <= known, "one version of a package in every set"
        assert all(len(value) == 64 for values in locked.values() for value in values)
        assert all(locked.values()), "no package without a hash"
        wanted = [line.partition("[")[0] for line in (folder / name).read_text().splitlines() if not line.startswith("#")]
        assert {normal(word) for word in wanted} <= {normal(pin.partition("==")[0]) for pin in locked}


ENTRY = """
id: PYSEC-2026-1
details: Thing runs
  what it is told.
affected:
- package: {name: thing, ecosystem: PyPI}
  ranges:
  - type: ECOSYSTEM
    events: [{introduced: "0"}, {fixed: 1.5.0}, {introduced: 2.0.0}, {last_affected: 2.1.0}]
  versions: [1.9.post1]
modified: "2026-11-02T10:00:00Z"
"""


@pytest.mark.parametrize(
    ("version", "weak"), [("1.4", 1), ("1.5.0", 0), ("1.9.post1", 1), ("2.0", 1), ("2.1.0", 1), ("2.1.1", 0)]
)
def test_known_weaknesses_are_found_without_a_network(version: str, weak: int, tmp_path: Path) -> None:
    (tmp_path / "vulns/thing").mkdir(parents=True)
    (tmp_path / "vulns/thing/PYSEC-2026-1.yaml").write_text(ENTRY)
    (tmp_path / "vulns/thing/PYSEC-2026-2.yaml").write_text(ENTRY + "withdrawn: '2026-11-03T10:00:00Z'\n")
    (tmp_path / "locked.txt").write_text(f"Thing=={version} \\\n    --hash=sha256:0\nother==1.0\n")
    command = [sys.executable, str(ROOT / ".ci/audit_offline.py"), str(tmp_path), str(tmp_path / "locked.txt")]
    done = subprocess.run(command, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False)
    line = f"thing {version}: PYSEC-2026-1 Thing runs what it is told.\n" * weak
    assert done.stdout == f"{line}2 packages, {weak} weaknesses known on 2026-11-02\n", done.stderr
    assert done.returncode == weak


def test_licences_of_ros_packages_are_those_they_state(tmp_path: Path) -> None:
    (tmp_path / "share/thing").mkdir(parents=True)
    stated = "<license>Apache\n License 2.0</license><license>MIT</license>"
    (tmp_path / "share/thing/package.xml").write_text(f"<package><name>thing</name><version>1.2.3</version>{stated}</package>")
    command = [sys.executable, str(ROOT / ".ci/ros_licences.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ['"Name","Version","License"', '"thing","1.2.3","Apache License 2.0; MIT"']


def test_pip_takes_nothing_without_its_hash(checkout: Path, tmp_path: Path) -> None:
    module = load(checkout / "tcs")
    command = module.pip("core", "test")
    assert "--require-hashes" in command
    assert "--no-build-isolation" in command, "what is built is built with what was checked"
    package = tmp_path / "wheels"
    package.mkdir()
    (package / "thing-1.0-py3-none-any.whl").write_bytes(b"not what was locked")
    (checkout / "requirements/locked/core.txt").write_text(f"thing==1.0 --hash=sha256:{'0' * 64}\n")
    (checkout / "requirements/locked/test.txt").write_text("")
    offline = ["--no-index", "--find-links", str(package), "--target", str(tmp_path / "there")]
    done = subprocess.run([sys.executable, *module.pip("core", "test")[1:], *offline], capture_output=True, text=True)
    assert done.returncode != 0
    assert "DO NOT MATCH THE HASHES" in done.stderr


def test_beside_a_ros_installation_its_own_numpy_stays(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = load(checkout / "tcs")
    assert module.pinned("core") == checkout / "requirements/locked/core.txt"
    monkeypatch.setattr(module, "sourced_prefixes", lambda: ["/opt/ros/jazzy"])
    before, after = pins(checkout / "requirements/locked/core.txt"), pins(module.pinned("core"))
    gone = set(before) - set(after)
    assert len(gone) == 1
    assert gone.pop().startswith("numpy==")
    assert all(before[name] == after[name] for name in after)


def test_a_place_that_cannot_be_written_is_one_line(checkout: Path) -> None:
    shutil.rmtree(checkout / ".tcs")
    (checkout / ".tcs").write_text("")
    result = run(checkout, "demo")
    assert result.returncode == 1
    assert result.stderr == f"tcs: cannot set up in {checkout}/.tcs: File exists\n"
