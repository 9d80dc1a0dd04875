"""Installs mech_twin with pip and with colcon alike; versions are pinned in constraints.txt."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "mech_twin"
NODES = ("motor_node", "linkage_node", "force_node", "body_node", "recorder_node", "viewer_node")


def files(folder, pattern):
    """Return the files of a folder as setuptools wants them."""
    return sorted(str(path) for path in Path(folder).glob(pattern))


setup(
    name=PACKAGE,
    version="0.1.0",
    description="Digital twin of percussion and crank-linkage machines",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", files("config", "*.*")),
        (f"share/{PACKAGE}/launch", files("launch", "*.launch.py")),
    ],
    install_requires=[
        "numpy", "scipy", "numba", "pydantic>=2", "PyYAML", "typer", "rich", "matplotlib", "pyarrow",
        "mcap", "mcap-ros2-support", "zstandard", "rosbags", "apsw", "rerun-sdk",
    ],
    extras_require={
        "jazzy": ["ros-jazzy-rclpy", "ros-jazzy-rmw-fastrtps-cpp", "ros-jazzy-common-interfaces"],
        "kilted": ["ros-rclpy", "ros-rmw-fastrtps-cpp", "ros-common-interfaces"],
        "cluster": ["dask[distributed]"],
        "test": [
            "pytest", "pytest-timeout", "hypothesis", "mpmath", "playwright", "psutil",
            "ruff", "mypy", "import-linter", "types-PyYAML", "colcon-common-extensions",
        ],
        "bench": ["pytest-benchmark", "pylinkage", "mujoco"],
    },
    entry_points={
        "console_scripts": [
            "mech-twin = mech_twin.cli.main:main",
            *(f"{node} = mech_twin.nodes.executables:{node}" for node in NODES),
        ]
    },
    zip_safe=False,
)  # fmt: skip
