"""The ROS 2 node of flightdepth: image and odometry in, depth (32FC1) and camera info out."""
