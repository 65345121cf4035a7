-- What the coordinator needs to know to distrust a worker or a job: how long a job has been
-- leased, failures in a row, audits. SQLite changes a check only with its table: `jobs` is
-- copied. The coordinator migrates with foreign keys off and checks them afterwards, for
-- other tables refer to this one meanwhile.

create table jobs_new (
    job integer primary key,
    study integer not null references studies (study),
    -- What it is for; the kind of computation follows from it. Which roles there are is known to
    -- the code that reads them, so that a further one does not copy this table again.
    role text not null,
    -- Index of the sample or of the optimisation; of an audit, that of the sample it flies again.
    -- Of a round of a search and of a generation: optimisation x 1000 + round; of a stroke it
    -- asked for: (optimisation x 1000 + round) x 1000 + stroke.
    ordinal integer not null,
    state text not null
        check (state in ('ready', 'delayed', 'leased', 'succeeded', 'infeasible', 'dead', 'cancelled')),
    -- Counts leases. It is the fencing token: a result must name the present one.
    attempt integer not null default 0,
    -- Counts failures and expiries. Apart from `attempt`, because a lease given back is no failure.
    failures integer not null default 0,
    -- The ten values of a stroke as a JSON array; null where the task is composed from the study.
    parameters text,
    -- Name of the simulation's content, by which equal ones are found across studies; null for
    -- other kinds, and for audits, which must be flown although their equal has a result.
    key blob check (length(key) = 32),
    -- Who has it, or had it last: a result that arrives just after expiry is still the present attempt's.
    worker blob references workers (id),
    -- When it was leased: a renewed lease may last for ever, an attempt may not.
    leased_ms integer,
    -- When the lease ends unless renewed.
    lease_until_ms integer,
    -- When a delayed job may be leased again.
    not_before_ms integer,
    -- Last failure, or why the stroke is infeasible.
    reason text,
    -- The worker's last word on a long job, JSON.
    progress text,
    -- The job whose result this one shares, when an equal simulation had been flown before.
    result_of integer references jobs (job),
    unique (study, role, ordinal)
) strict;

insert into jobs_new select job, study, role, ordinal, state, attempt, failures, parameters, key, worker, null, lease_until_ms, not_before_ms, reason, progress, result_of from jobs;
drop table jobs;
alter table jobs_new rename to jobs;

-- Indexes and triggers went with their table.
create index jobs_ready on jobs (study, role, ordinal) where state = 'ready';
create index jobs_delayed on jobs (not_before_ms) where state = 'delayed';
create index jobs_leased on jobs (lease_until_ms) where state = 'leased';
create index jobs_leased_by on jobs (worker) where state = 'leased';
create index jobs_dead on jobs (study, role) where state = 'dead';
create index jobs_key on jobs (key) where key is not null;

create trigger jobs_counted_on_insert after insert on jobs begin
    insert into study_counts (study, role, state, n) values (new.study, new.role, new.state, 1)
    on conflict (study, role, state) do update set n = n + 1;
end;

create trigger jobs_counted_on_change after update of state on jobs when old.state <> new.state begin
    update study_counts set n = n - 1 where study = old.study and role = old.role and state = old.state;
    insert into study_counts (study, role, state, n) values (new.study, new.role, new.state, 1)
    on conflict (study, role, state) do update set n = n + 1;
end;

create trigger checkpoints_end after update of state on jobs
    when new.state in ('succeeded', 'infeasible', 'cancelled') begin
    delete from checkpoints where job = new.job;
end;

-- Attempts failed since this worker's last success.
alter table workers add column strikes integer not null default 0;
-- Until when it is given no jobs, because too many attempts in a row failed with it.
alter table workers add column quarantined_until_ms integer;
-- Whether it was asked to finish what it has and leave.
alter table workers add column draining integer not null default 0 check (draining in (0, 1));

-- Evidence is looked for by class.
create index refused_by_class on refused_results (class, refused);
