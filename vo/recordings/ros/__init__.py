"""Bags of ROS 1 and 2, read by the library rosbags, which is imported when a bag is opened."""
