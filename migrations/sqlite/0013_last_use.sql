-- When the coordinator was last at work: a clock which is far ahead of that is not believed at once,
-- for by it studies are removed.
create table last_use (
    one integer primary key check (one = 1),
    seen_ms integer not null
) strict;

insert into last_use (one, seen_ms)
select 1, max(ms) from (
    select max(created_ms) as ms from studies
    union all
    select max(coalesce(ended_ms, started_ms)) from study_stages
    union all
    select max(last_seen_ms) from workers)
having max(ms) is not null;

-- The same rows as before, without an order inside an aggregate, which SQLite has only since 3.44: earlier
-- versions read no table of a file with such a view. The rows of the subquery come in its order, and
-- `json_group_array` keeps it.
drop view study_specs;

create view study_specs as
select s.study, s.id,
    iif(exists (select 1 from added_optimisations as a where a.study = s.study),
        json_set(s.spec, '$.optimisations', json((
            select json_group_array(json(o.spec)) from (
                select submitted.key as ordinal, submitted.value as spec
                from json_each(s.spec, '$.optimisations') as submitted
                union all
                select a.ordinal, a.spec from added_optimisations as a where a.study = s.study
                order by ordinal) as o))),
        s.spec) as spec
from studies as s;
