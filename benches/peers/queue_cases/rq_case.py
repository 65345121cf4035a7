"""PORT JOBS WORKERS: a backlog worked off by RQ's workers, which do not fork for each job."""

import subprocess
import sys

import redis
from rq import Queue
from rq_tasks import nothing
from timing import rate, tell

port, jobs, workers = map(int, sys.argv[1:])
store = redis.Redis(port=port)
queue = Queue(connection=store)
queue.enqueue_many([Queue.prepare_data(nothing, result_ttl=3600) for _ in range(jobs)])
line = [sys.executable, "-m", "rq.cli", "worker", "--url", f"redis://127.0.0.1:{port}", "--quiet"]
line += ["--worker-class", "rq.worker.SimpleWorker", "--path", "."]
running = [subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for _ in range(workers)]
try:
    jobs_s = rate(lambda: store.zcard("rq:finished:default"), jobs)
finally:
    for worker in running:
        worker.terminate()
        worker.wait(30)
tell(jobs_s, jobs)
