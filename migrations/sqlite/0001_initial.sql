-- The coordinator's store. Times are the coordinator's own clock in
-- milliseconds since 1970: no worker's clock ever enters it. An applied
-- migration is never edited.

create table studies (
    -- Short number: every job row and index entry carries it, the 16 bytes of the public id only this table.
    study integer primary key,
    -- Public id, a UUID of version 7.
    id blob not null unique check (length(id) = 16),
    -- For lists, which must not parse the specification of every study.
    name text not null,
    -- The study as submitted, canonical JSON: all later decisions are made from it.
    spec text not null,
    -- Where the study is. It stays while a study is paused or failed, so that both can return to it.
    stage text not null check (stage in ('sampling', 'training', 'optimising', 'verifying')),
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

-- Which studies still move is asked at every start.
create index studies_running on studies (study) where condition = 'running';

-- When each stage began and ended, for `stages_s`.
create table study_stages (
    study integer not null references studies (study),
    stage text not null,
    started_ms integer not null,
    -- Null while it lasts.
    ended_ms integer,
    primary key (study, stage)
) strict, without rowid;

create table workers (
    -- Unique to the process: a restarted worker is another worker, and so fenced off from its old leases.
    id blob primary key check (length(id) = 16),
    -- For people.
    name text not null,
    slots integer not null,
    -- Instruction level, for people looking for the odd machine out.
    level text not null,
    registered_ms integer not null,
    last_seen_ms integer not null,
    -- When it said goodbye; from then on it is unknown to the exchange.
    left_ms integer,
    completed integer not null default 0,
    failed integer not null default 0
) strict, without rowid;

-- The list of workers shows those heard of lately, not all there ever were.
create index workers_seen on workers (last_seen_ms) where left_ms is null;

create table jobs (
    job integer primary key,
    study integer not null references studies (study),
    -- What it is for; the kind of computation follows from it.
    role text not null check (role in ('sample', 'train', 'optimise', 'verify')),
    -- Index of the sample or of the optimisation.
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

-- Partial indexes: the queue holds what waits, however many jobs are done.
create index jobs_ready on jobs (study, role, ordinal) where state = 'ready';
create index jobs_delayed on jobs (not_before_ms) where state = 'delayed';
create index jobs_leased on jobs (lease_until_ms) where state = 'leased';
create index jobs_leased_by on jobs (worker) where state = 'leased';
create index jobs_dead on jobs (study, role) where state = 'dead';
create index jobs_key on jobs (key) where key is not null;

-- How many jobs are in each state, per study and role. Kept by the triggers
-- below in the very transaction of the change: no code path can forget it, and
-- nothing ever counts the jobs themselves.
create table study_counts (
    study integer not null references studies (study),
    role text not null,
    state text not null,
    n integer not null check (n >= 0),
    primary key (study, role, state)
) strict, without rowid;

-- Which studies have work to give: what every claim asks first.
create index study_counts_ready on study_counts (study, role) where state = 'ready' and n > 0;

create trigger jobs_counted_on_insert after insert on jobs begin
    insert into study_counts (study, role, state, n) values (new.study, new.role, new.state, 1)
    on conflict (study, role, state) do update set n = n + 1;
end;

create trigger jobs_counted_on_change after update of state on jobs when old.state <> new.state begin
    update study_counts set n = n - 1 where study = old.study and role = old.role and state = old.state;
    insert into study_counts (study, role, state, n) values (new.study, new.role, new.state, 1)
    on conflict (study, role, state) do update set n = n + 1;
end;

-- Apart from the queue, whose rows change often and must stay small.
create table results (
    job integer primary key references jobs (job),
    -- Which attempt of which worker gave it: the same three and the same digest are a replay.
    attempt integer not null,
    worker blob not null references workers (id),
    -- blake3 of the body before compression: equal simulations must have equal ones.
    digest blob not null check (length(digest) = 32),
    -- The result, JSON; compressed with zstd where large (its magic number tells).
    body blob not null,
    -- What status pages show of a training, JSON without the weights.
    summary text,
    -- Provenance beside the result, not in it: equal simulations have equal results.
    wall_s real not null,
    level text not null,
    finished_ms integer not null
) strict;

-- Evidence: results refused, and results which contradict one already taken.
-- Bounded: the oldest rows make room.
create table refused_results (
    refused integer primary key,
    job integer not null,
    attempt integer not null,
    worker blob not null,
    -- `refused`, or `nondeterminism` where equal machines gave different numbers.
    class text not null check (class in ('refused', 'nondeterminism')),
    reason text not null,
    digest blob not null,
    -- Null where too large to keep.
    body blob,
    level text not null,
    refused_ms integer not null
) strict;
