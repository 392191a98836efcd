"""`./tcs ros`: what the command line of ROS 2 does with services, topics, parameters, life cycles and actions.

Its package cannot be had where ROS comes as wheels. Names, arguments and output are those of `ros2`, so that what is written for
one can be typed with the other.
"""
