"""Package of the ROS 2 node; flightdepth itself comes from pip."""

from setuptools import setup

NAME = "flightdepth_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="flightdepth",
    maintainer_email="flightdepth@users.noreply.github.com",
    description="Metric depth from a drone's camera and its odometry",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"depth = {NAME}.node:main"]},
)
