"""The memory without a robot: learners, measures, report."""
