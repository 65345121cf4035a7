-- What the coordinator needs to find a worker that returns wrong results, and to undo them.

-- 32 random bytes that decide which samples are audited, so that nobody can guess it. No view has them.
alter table studies add column secret blob;
update studies set secret = randomblob(32);
-- Whether the study takes no results of other studies.
alter table studies add column fresh integer not null default 0 check (fresh in (0, 1));

-- Since when the worker is given no jobs because of wrong results, until an operator readmits it.
alter table workers add column set_aside_ms integer;
-- Why, a sentence.
alter table workers add column set_aside_reason text;

-- A registration asks whether a worker of its name was set aside: few were, and only those are here.
create index workers_set_aside on workers (name) where set_aside_ms is not null;

-- Disowning a worker asks for all of its results.
create index results_by_worker on results (worker);

-- Comparisons of a sample with its audit.
create table audits (
    -- The audit.
    job integer primary key references jobs (job),
    study integer not null references studies (study),
    -- The sample.
    sample integer not null references jobs (job),
    -- Whether the two results came in under different tokens.
    independent integer not null check (independent in (0, 1)),
    -- `agrees`; `disputed` until the coordinator has flown it too; `undecided` where it could not.
    verdict text not null check (verdict in ('agrees', 'disputed', 'undecided')),
    -- How often the coordinator has begun to fly it.
    tries integer not null default 0
) strict;

-- Views count verdicts by study, and a stage is not over while one is open.
create index audits_by_study on audits (study, verdict, independent);
create index audits_disputed on audits (job) where verdict = 'disputed';
create index audits_by_sample on audits (sample);

-- Jobs whose result came from a worker whose results were disowned later, and which were past the point where they
-- could be computed again. Apart from `results`, because jobs that share a result are marked each for itself.
create table disowned (
    job integer primary key references jobs (job),
    study integer not null references studies (study),
    worker blob not null references workers (id),
    since_ms integer not null
) strict;

create index disowned_by_study on disowned (study, worker);

-- The jobs whose result is being disowned: filled and emptied within one transaction.
create table touched (
    job integer primary key,
    -- The job that has the result: this one, or the one it shares with.
    owner integer not null,
    study integer not null,
    role text not null,
    ordinal integer not null,
    -- Whether its study still samples.
    samples integer not null
) strict;

-- How many results of a worker were dropped from a study and their jobs queued again.
create table replaced (
    study integer not null references studies (study),
    worker blob not null references workers (id),
    n integer not null,
    primary key (study, worker)
) strict, without rowid;

-- Results that are acknowledged and on disk, and not believed yet: trainings, optima and rounds of searches are checked
-- first, which takes longer than a request may. Their jobs stay leased meanwhile.
create table unchecked_results (
    job integer primary key references jobs (job),
    attempt integer not null,
    worker blob not null references workers (id),
    digest blob not null check (length(digest) = 32),
    body blob not null,
    summary text,
    wall_s real not null,
    level text not null,
    came_ms integer not null
) strict;

-- However a job is taken from its worker, nobody waits for its result to be checked any more.
create trigger unchecked_results_end after update of state on jobs when old.state = 'leased' and new.state <> 'leased' begin
    delete from unchecked_results where job = new.job;
end;
