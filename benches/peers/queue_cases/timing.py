"""Times a backlog from the first results to the last one, so that no start is counted."""

import json
import time


def rate(finished, jobs, patience=600):
    """Jobs per second; `finished()` is how many have ended."""
    started = time.perf_counter()
    first, since = 0, started
    while True:
        now, n = time.perf_counter(), finished()
        if first == 0 and n > 0:
            first, since = n, now
        if n >= jobs:
            return (jobs - first) / (now - since)
        if now - started > patience:
            raise TimeoutError(f"{n} of {jobs} jobs after {patience} s")
        time.sleep(0.01)


def tell(jobs_s, jobs):
    print(json.dumps({"jobs_s": jobs_s, "jobs": jobs}))
