//! Every message of manduca that crosses HTTP, its ids and its errors, and the
//! one checked conversion ([`resolve`]) into what the science accepts.

pub mod answer;
mod flat;
pub mod flight;
pub mod front;
pub mod history;
pub mod ids;
pub mod names;
pub mod network;
pub mod optimum;
mod outcome;
pub mod overview;
pub mod paper;
pub mod point;
pub mod problem;
pub mod remarks;
pub mod resolve;
pub mod search;
pub mod strict;
pub mod study;
pub mod task;
pub mod text;
pub mod training;
pub mod trust;
pub mod view;
pub mod watch;
pub mod who;
mod whole;
pub mod worker;
