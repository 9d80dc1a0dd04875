# SPDX-License-Identifier: Apache-2.0
"""Installs mech_twin with pip and with colcon alike; exact versions of a tried set are in constraints/."""

import re
from pathlib import Path

from setuptools import Distribution, find_packages, setup

try:
    from setuptools.command.bdist_wheel import bdist_wheel
    from setuptools.command.editable_wheel import editable_wheel
except ImportError:  # Ubuntu's setuptools, which colcon uses on a native installation, makes no wheels
    bdist_wheel = None

PACKAGE = "mech_twin"
NODES = ("motor_node", "linkage_node", "force_node", "body_node", "frames_node", "recorder_node", "viewer_node")
INDEX = [  # by which ros2 and ament find the package
    ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
    (f"share/{PACKAGE}", ["package.xml"]),
]
LAUNCHER = """#!/bin/sh
exec "$(dirname -- "$0")/../../bin/$(basename -- "$0")" "$@"
"""


def files(folder, pattern):
    """Return the files of a folder as setuptools wants them."""
    return sorted(str(path) for path in Path(folder).glob(pattern))


def version():
    """Return the version, which is written in the package alone (package.xml and CITATION.cff repeat it, tested)."""
    text = Path(__file__).with_name(PACKAGE).joinpath("__init__.py").read_text(encoding="utf-8")
    return re.search(r'^__version__ = "(.+)"$', text, re.MULTILINE).group(1)


def launchers(folder):
    """Write a program for each of pip's in bin/ that starts it from lib/mech_twin, where `ros2 run` looks."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("mech-twin", *NODES):
        folder.joinpath(name).write_text(LAUNCHER, encoding="utf-8")
        folder.joinpath(name).chmod(0o755)
    return files(folder, "*")


class WithData(Distribution):
    """The package; an editable installation takes its data files too where it answers to `has_data`."""

    has_data = Distribution.has_data_files


def commands():
    """Return the commands that make wheels; colcon puts its programs into lib/mech_twin itself."""
    if bdist_wheel is None:
        return {}

    class Wheel(bdist_wheel):
        def run(self):
            self.distribution.data_files.append((f"lib/{PACKAGE}", launchers(Path("build/launchers"))))
            super().run()

    class EditableWheel(editable_wheel):
        def run(self):  # configuration and launch files stay in the source tree alone, where they are edited
            self.distribution.data_files = [*INDEX, (f"lib/{PACKAGE}", launchers(Path("build/launchers")))]
            super().run()

    return {"bdist_wheel": Wheel, "editable_wheel": EditableWheel}


setup(
    name=PACKAGE,
    version=version(),
    description="Digital twin of percussion and crank-linkage machines",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed", "__init__.pyi"],
        f"{PACKAGE}.view.bench": ["page/*"],
        f"{PACKAGE}.fmi": ["sources/*"],
    },
    data_files=[
        *INDEX,
        (f"share/{PACKAGE}/config", files("config", "*.*")),
        (f"share/{PACKAGE}/config/pages", files("config/pages", "*.yaml")),
        (f"share/{PACKAGE}/launch", files("launch", "*.launch.py")),
        (f"share/{PACKAGE}/rviz", files("rviz", "*.rviz")),
        (f"share/{PACKAGE}/foxglove", files("foxglove", "*.json")),
    ],
    # lower bounds: the oldest set with which the fast tests pass (docs/releasing.md says how that is tried)
    install_requires=[
        "numpy>=1.26", "scipy>=1.11.4", "numba>=0.68", "pydantic>=2.7", "PyYAML>=6.0.1",
        "typer>=0.29", "rich>=13.7", "mcap>=1.6", "mcap-ros2-support>=0.5.5", "zstandard>=0.22", "lz4>=4.0.2",
        "rosbags>=0.11.1", "apsw>=3.46", "llvmlite",
    ],
    extras_require={
        "jazzy": ["ros-jazzy-rclpy", "ros-jazzy-rmw-fastrtps-cpp", "ros-jazzy-common-interfaces"],
        "kilted": ["ros-rclpy", "ros-rmw-fastrtps-cpp", "ros-common-interfaces"],
        "view": ["aiohttp>=3.11", "rerun-sdk>=0.41", "pyarrow>=18"],
        "plots": ["matplotlib>=3.8", "pillow>=10.2"],
        "tables": ["pyarrow>=18"],
        "pandas": ["pandas>=2.2"],
        "foxglove": ["foxglove-sdk>=0.30"],
        "alerts": ["paho-mqtt>=2.1", "prometheus_client>=0.20"],
        "cluster": ["distributed>=2026.8"],
        "fmu": ["ziglang>=0.14"],
        "life": ["rainflow>=3.2"],
        "cuda": ["numba-cuda[cu12]>=0.30"],
        "test": [
            "pytest", "pytest-timeout", "pytest-cov", "pytest-xdist", "hypothesis", "mpmath", "playwright", "psutil",
            "rosbags", "pandas", "ruff", "mypy", "import-linter", "types-PyYAML", "colcon-common-extensions",
            "urdf-parser-py", "fmpy", "libcosimpy", "grafana-foundation-sdk",
        ],
        "bench": ["pylinkage", "mujoco[sysid]", "exudyn", "ruptures", "lmfit"],
        "docs": ["mkdocs<2", "mkdocs-material", "mkdocstrings", "mkdocstrings-python"],
    },
    entry_points={
        "console_scripts": [
            "mech-twin = mech_twin.programs:command",
            *(f"{node} = mech_twin.programs:{node}" for node in NODES),
        ]
    },
    cmdclass=commands(),
    distclass=WithData,
    zip_safe=False,
)  # fmt: skip
