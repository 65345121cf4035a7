-- A stage in which optima are refined, and jobs for its searches. SQLite changes a
-- check only with its table: both are copied. The coordinator migrates with foreign
-- keys off and checks them afterwards, for other tables refer to these meanwhile.

create table studies_new (
    -- Short number: every job row and index entry carries it, the 16 bytes of the public id only this table.
    study integer primary key,
    -- Public id, a UUID of version 7.
    id blob not null unique check (length(id) = 16),
    -- For lists, which must not parse the specification of every study.
    name text not null,
    -- The study as submitted, canonical JSON: all later decisions are made from it.
    spec text not null,
    -- Where the study is. It stays while a study is paused or failed, so that both can return to it.
    stage text not null check (stage in ('sampling', 'training', 'optimising', 'verifying', 'refining')),
    -- Whether it moves. `running` and `stage` together are what users call its state.
    condition text not null check (condition in ('running', 'paused', 'succeeded', 'failed', 'cancelled')),
    -- Why it failed, a sentence.
    failure text,
    -- Samples wanted, copied from the specification for lists and for `advance`.
    samples integer not null,
    -- First sample index not yet drawn: further draws continue the one sequence, so every run draws alike.
    next_sample integer not null,
    -- Optimisations asked for, to know without parsing whether a stage has work.
    optimisations integer not null,
    created_ms integer not null,
    -- The client's Idempotency-Key; a second submission under it finds the first.
    idempotency_key text unique,
    -- blake3 of `spec`: tells a repeated submission from another one under the same key.
    spec_digest blob not null check (length(spec_digest) = 32)
) strict;

insert into studies_new select study, id, name, spec, stage, condition, failure, samples, next_sample, optimisations, created_ms, idempotency_key, spec_digest from studies;
drop table studies;
alter table studies_new rename to studies;

create table jobs_new (
    job integer primary key,
    study integer not null references studies (study),
    -- What it is for; the kind of computation follows from it.
    role text not null check (role in ('sample', 'train', 'optimise', 'verify', 'search', 'probe')),
    -- Index of the sample or of the optimisation. Of a round of a search: optimisation x 1000 + round;
    -- of a stroke it asked for: (optimisation x 1000 + round) x 1000 + stroke.
    ordinal integer not null,
    state text not null
        check (state in ('ready', 'delayed', 'leased', 'succeeded', 'infeasible', 'dead', 'cancelled')),
    -- Counts leases. It is the fencing token: a result must name the present one.
    attempt integer not null default 0,
    -- Counts failures and expiries. Apart from `attempt`, because a lease given back is no failure.
    failures integer not null default 0,
    -- The ten values of a stroke as a JSON array; null where the task is composed from the study.
    parameters text,
    -- Name of the simulation's content, by which equal ones are found across studies; null for other kinds.
    key blob check (length(key) = 32),
    -- Who has it, or had it last: a result that arrives just after expiry is still the present attempt's.
    worker blob references workers (id),
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

insert into jobs_new select job, study, role, ordinal, state, attempt, failures, parameters, key, worker, lease_until_ms, not_before_ms, reason, progress, result_of from jobs;
drop table jobs;
alter table jobs_new rename to jobs;

-- Indexes and triggers went with their table.
create index studies_running on studies (study) where condition = 'running';
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
