-- Who did what, and who failed what. Names of tokens stand here as text, not as references: they
-- are never used twice, and a revoked token keeps its name.

-- The token that registered the worker: only this token speaks for it. Null where no tokens are asked for,
-- and in rows from before; the first token that speaks for such a worker becomes its own.
alter table workers add column token text;
-- The token that asked it to leave.
alter table workers add column drained_by text;
-- The token that submitted the study, null where no tokens were asked for.
alter table studies add column submitted_by text;
-- The token that last paused, resumed, cancelled or retried it, or added an optimisation.
alter table studies add column steered_by text;
-- The token of the worker that returned the result.
alter table refused_results add column token text;

-- Attempts that failed, by worker. They decide whether the job or the machine is at fault, and go when the job
-- has an answer; those of a job given up go with their study.
create table failures (
    job integer not null references jobs (job) on delete cascade,
    attempt integer not null,
    -- Not a reference: rows of workers long gone are removed.
    worker blob not null check (length(worker) = 16),
    -- What the worker blames: the task refused, the task failed, or its machine.
    fault text not null check (fault in ('refused', 'failed', 'machine')),
    reason text not null,
    failed_ms integer not null,
    -- Whether it is among the strikes of its worker.
    struck integer not null default 0 check (struck in (0, 1)),
    -- Whether the fate of the job is open: other workers may yet confirm or contradict the failure.
    open integer not null default 1 check (open in (0, 1)),
    primary key (job, attempt)
) strict, without rowid;

-- How many failures of a worker nobody has confirmed or contradicted yet.
create index failures_open on failures (worker) where open = 1;

-- A job that gets its answer from elsewhere, or is cancelled, blames nobody.
create trigger failures_end after update of state on jobs
    when old.failures > 0 and new.state in ('succeeded', 'infeasible', 'cancelled') begin
    delete from failures where job = new.job;
end;

-- Evidence is bounded by class and worker.
create index refused_by_worker on refused_results (class, worker, refused);
