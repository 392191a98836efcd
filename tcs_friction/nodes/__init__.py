"""The ROS nodes: a callback converts, calls the core, converts and publishes. Only this room imports rclpy."""

import os

os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
"""Fast DDS otherwise passes messages through shared memory, which a killed or stopped process leaves in disorder.

The survivors then may no longer hear each other (eProsima/Fast-DDS issues 2811 and 5469). What UDP costs: docs/real-time.md.
"""
