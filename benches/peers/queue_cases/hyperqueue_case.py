"""JOBS WORKERS: a HyperQueue server and worker of this process, and a job of so many tasks."""

import sys
import tempfile
import time

from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

from timing import tell

jobs, workers = map(int, sys.argv[1:])
with tempfile.TemporaryDirectory() as folder, LocalCluster() as cluster:
    cluster.start_worker(WorkerConfig(cores=workers))
    client = cluster.client()
    job = Job(default_workdir=folder)
    for _ in range(jobs):
        job.program(["true"], stdout=None, stderr=None)
    start = time.perf_counter()
    submitted = client.submit(job)
    client.wait_for_jobs([submitted])
    tell(jobs / (time.perf_counter() - start), jobs)
