"""PORT JOBS WORKERS PREFETCH: a backlog worked off by Celery's processes."""

import os
import signal
import subprocess
import sys

port, jobs, workers, prefetch = map(int, sys.argv[1:])
os.environ |= {"QUEUE_REDIS": f"redis://127.0.0.1:{port}/0", "QUEUE_PREFETCH": str(prefetch)}

import redis
from celery_tasks import app, nothing
from timing import rate, tell

store = redis.Redis(port=port)
with app.producer_pool.acquire(block=True) as producer:
    for _ in range(jobs):
        nothing.apply_async(producer=producer)
line = [sys.executable, "-m", "celery", "-A", "celery_tasks", "worker", "--pool", "prefork", "--loglevel", "ERROR"]
line += ["--concurrency", str(workers), "--without-gossip", "--without-mingle", "--without-heartbeat"]
worker = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
try:
    # Its results are the only keys which grow, beside a handful of its bookkeeping.
    others = 10
    jobs_s = rate(lambda: max(0, store.dbsize() - others), jobs - others)
finally:
    # Asked to leave it may wait for its children for ever; nothing is left to be kept.
    os.killpg(worker.pid, signal.SIGKILL)
    worker.wait()
tell(jobs_s, jobs)
