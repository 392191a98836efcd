"""The ROS nodes: a callback converts, calls the core, converts and publishes. Only this room imports rclpy."""

import os

os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
"""Over a network Fast DDS otherwise has shared memory too, which a killed or stopped process leaves in disorder.

The survivors then may no longer hear each other (eProsima/Fast-DDS issues 2811 and 5469). Where nodes are found on this machine
only, ROS chooses shared memory whatever this says: docs/real-time.md.
"""
