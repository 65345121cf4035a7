//! What lies between HTTP and the handlers: connections, bodies, paths, queries, cursors, entity tags
//! and headers of answers, each with its refusals.

pub(crate) mod body;
pub(crate) mod connection;
pub(crate) mod cursor;
pub(crate) mod etag;
pub(crate) mod headers;
pub(crate) mod parse;
pub(crate) mod parts;
pub(crate) mod scan;
pub(crate) mod stretch;
