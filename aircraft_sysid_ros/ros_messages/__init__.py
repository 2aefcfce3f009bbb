"""ROS messages to samples and back: the only place where frames and units change."""
