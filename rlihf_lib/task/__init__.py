"""The robot's world: scene, control, ideal path, Gymnasium interface."""

import logging

# robosuite greets every import and every environment with a burst of warnings; its logger exists
# before it does, so that the filter is there whichever module imports robosuite first.
logging.getLogger("robosuite_logs").addFilter(lambda record: record.levelno >= logging.ERROR)
