set client_min_messages = warning;
-- A queue as small as can be: 0 ready, 1 leased, 2 succeeded.
drop table if exists jobs;
create table jobs (id bigint primary key, state smallint not null default 0, attempt int not null default 0, result text);
insert into jobs (id) select generate_series(1, 100000);
create index ready on jobs (id) where state = 0;
analyze jobs;
checkpoint;
