-- Written while the disk refuses: only a write which must reach the disk shows that it takes
-- writes again.
create table heartbeat (
    one integer primary key check (one = 1),
    beat_ms integer not null
) strict;
