"""The ROS nodes: a callback converts, calls the core, converts and publishes. Only this room imports rclpy."""
