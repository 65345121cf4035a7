-- Attempts lost with their worker, apart from `failures`: what takes a worker is hardly ever its
-- job, for a job which crashes or does not end costs the worker a slot's process alone.
alter table jobs add column losses integer not null default 0;
