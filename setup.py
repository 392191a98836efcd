from __future__ import annotations

from pathlib import Path

from setuptools import find_packages, setup

NODES = (
    "canopen_drive",
    "commission",
    "controller",
    "diagnoser",
    "dob",
    "dynamometer",
    "identifier",
    "lugre_compensator",
    "monitor",
    "mujoco_plant",
    "plant",
    "player",
    "recorder",
    "reference",
    "ros2_control_driver",
)


def files(folder: str, pattern: str) -> list[str]:
    return sorted(str(path) for path in Path(folder).glob(pattern))


setup(
    name="tcs_friction",
    version="0.1.0",
    description="Measures, identifies, compensates and diagnoses the friction of servo axes",
    license="Apache-2.0",
    maintainer="tcs_friction maintainers",
    maintainer_email="tcs-friction@example.org",
    packages=find_packages(include=["tcs_friction", "tcs_friction.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tcs_friction"]),
        ("share/tcs_friction", ["package.xml"]),
        ("bin", ["bin/tcs-friction"]),
        ("share/tcs_friction/config", files("config", "*.yaml") + files("config", "*.xml")),
        ("share/tcs_friction/launch", files("launch", "*.launch.py")),
        ("share/tcs_friction/layouts", files("layouts", "*")),
        ("share/tcs_friction/security", files("security", "*.xml")),
    ],
    package_data={
        "tcs_friction.live": ["page/*"],
        "tcs_friction.report.assets": ["LICENSE", "README.md", "plots.js", "touch.js", "uPlot.*"],
    },
    python_requires=">=3.11",
    install_requires=["setuptools"],
    extras_require={
        "test": ["pytest"],  # colcon test runs nothing without it
        "canopen": ["canopen", "python-can"],
        "fleet": ["aiohttp", "bokeh", "dask", "distributed", "fsspec", "s3fs"],
        "hardware": ["pyserial"],
        "live": ["starlette", "uvicorn", "websockets"],
        "mujoco": ["mujoco"],
        "bench": ["cma", "mujoco", "pymoo", "pysindy"],
    },
    zip_safe=True,
    entry_points={
        "console_scripts": [
            "tcs-friction = tcs_friction.cli:main",
            *(f"{name} = tcs_friction.nodes.entry:{name}" for name in NODES),
        ],
    },
)
