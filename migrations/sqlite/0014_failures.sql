-- How often a worker failed lately, whatever became of it: what one without a success may do.
create index failures_of on failures (worker, failed_ms);
