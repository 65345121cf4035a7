-- Optimisations asked for after their study had its network.

create table added_optimisations (
    study integer not null references studies (study),
    -- Place among all optimisations of the study, those submitted with it first: the ordinal of its jobs.
    ordinal integer not null,
    -- The optimisation as asked for, canonical JSON. Apart from `studies.spec`, which stays what was submitted.
    spec text not null,
    -- When it was asked for; a study says so of itself only.
    added_ms integer not null,
    primary key (study, ordinal)
) strict, without rowid;

-- What is asked of each study by now: as submitted, with what was added. Every
-- decision reads this, so that none can know an optimisation's job but not the optimisation.
create view study_specs as
select s.study, s.id,
    iif(exists (select 1 from added_optimisations as a where a.study = s.study),
        json_set(s.spec, '$.optimisations', json((
            select json_group_array(json(o.spec) order by o.ordinal) from (
                select submitted.key as ordinal, submitted.value as spec
                from json_each(s.spec, '$.optimisations') as submitted
                union all
                select a.ordinal, a.spec from added_optimisations as a where a.study = s.study) as o))),
        s.spec) as spec
from studies as s;
