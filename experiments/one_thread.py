"""Import this first: it pins numerical libraries to one thread, those of all processes that are started afterwards.

NumPy's own BLAS keeps its threads in this process, for ``import packenv`` loads it before; it uses them for large
matrices alone.
"""

import os

from packenv.backends.ray_pool import ONE_THREAD

os.environ.update(ONE_THREAD)
