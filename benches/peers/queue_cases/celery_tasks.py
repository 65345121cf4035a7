"""The job, as Celery knows it."""

import os

from celery import Celery

url = os.environ["QUEUE_REDIS"]
app = Celery("celery_tasks", broker=url, backend=url)
app.conf.update(task_ignore_result=False, worker_prefetch_multiplier=int(os.environ.get("QUEUE_PREFETCH", "16")))
RESULT = "x" * 1024


@app.task
def nothing():
    return RESULT
