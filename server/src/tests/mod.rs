//! The coordinator as its users and workers meet it, on a clock moved by hand,
//! with workers whose results are made up.

mod absence;
mod access;
mod add;
mod answers;
mod bench;
mod blame;
mod bounded;
mod checkpoints;
mod damage;
mod dataset;
mod direct;
mod front;
mod fuzz;
mod http;
mod identity;
mod liars;
mod long_poll;
mod look;
mod overview;
mod plans;
mod queue;
mod restart;
mod revoked;
mod share;
mod shares;
mod simulation;
mod sites;
mod stages;
mod steer;
mod trust;
mod watch;
mod wire;
mod writer;
