"""The robot: TX90 kinematics, vacuum gripper, cell layout, URDF."""
