-- Where a long job stands, told with its renewals: the next attempt goes on from
-- there. A row lives as long as its job is open.
create table checkpoints (
    job integer primary key references jobs (job),
    -- Which attempt told it: a late one must not replace that of its successor.
    attempt integer not null,
    -- The checkpoint, JSON; compressed with zstd where large (its magic number tells).
    body blob not null,
    saved_ms integer not null
) strict;

-- However a job ends, nobody goes on from its checkpoint any more.
create trigger checkpoints_end after update of state on jobs
    when new.state in ('succeeded', 'infeasible', 'cancelled') begin
    delete from checkpoints where job = new.job;
end;
