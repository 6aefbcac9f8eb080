"""Robots and their cells: kinematics, shapes, gripper, container beside it, motion, URDF, and the files of these.

It imports what is below it alone: types, errors, and where RobotPack's own files are.
"""
