"""rclpy nodes, one per concept: thin shells around the estimators, which know nothing of ROS."""
