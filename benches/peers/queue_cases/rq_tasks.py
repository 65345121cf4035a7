"""The job, as RQ knows it."""

RESULT = "x" * 1024


def nothing():
    return RESULT
