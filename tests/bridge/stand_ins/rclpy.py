"""What the example uses of rclpy."""

from journal import note


def init(args=None):
    note("rclpy.init")


def shutdown():
    note("rclpy.shutdown")
