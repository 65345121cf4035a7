-- Version of the numbers a study was begun with: results of two versions are never mixed. Null in
-- studies from before it was kept, whose version was 4 or an earlier one.
alter table studies add column solver_version text;
-- The version a worker computes with, which it said when it registered.
alter table workers add column solver_version text;
