-- For which studies each worker has returned results. Disowning a worker and removing one ask for that seldom, and
-- results come in all the time: an index of results by worker cost each commit a page for every worker in it.
create table worked (
    worker blob not null check (length(worker) = 16),
    study integer not null references studies (study),
    primary key (worker, study)
) strict, without rowid;

insert into worked (worker, study) select distinct r.worker, j.study from results as r join jobs as j on j.job = r.job;

create trigger results_noted after insert on results begin
    insert or ignore into worked (worker, study) select new.worker, study from jobs where job = new.job;
end;

-- A result may be handed on to a job of another study.
create trigger results_handed_on after update of job on results begin
    insert or ignore into worked (worker, study) select new.worker, study from jobs where job = new.job;
end;

drop index results_by_worker;

-- Only large results wait to be checked: no other job is looked for among them.
drop trigger unchecked_results_end;
create trigger unchecked_results_end after update of state on jobs
    when old.state = 'leased' and new.state <> 'leased' and new.role in ('train', 'optimise', 'search', 'generation')
begin
    delete from unchecked_results where job = new.job;
end;

-- Who wrote a checkpoint, and whether it goes on from one that another worker wrote: a training that fails from what
-- another computed begins anew.
alter table checkpoints add column worker blob;
alter table checkpoints add column inherited integer not null default 0 check (inherited in (0, 1));
create index checkpoints_by_worker on checkpoints (worker);
