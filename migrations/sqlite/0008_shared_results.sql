-- Deleting a job asks whether others share its result: without an index each deletion reads all
-- jobs. Few share one, and only those are in it.
create index jobs_shared on jobs (result_of) where result_of is not null;
