"""Import this first: it pins every numerical library to one thread."""

import os

from packenv.backends.ray_pool import ONE_THREAD

os.environ.update(ONE_THREAD)
