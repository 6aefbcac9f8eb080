"""Which places an item could take, and how good each is: heightmaps in, scored candidates out.

May import geometry and the constraints' protocol; knows nothing of stability, of the robot or of files.
"""
