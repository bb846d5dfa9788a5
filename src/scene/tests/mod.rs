//! Tests of the scene format.
#![allow(clippy::unwrap_used, reason = "what is not there fails the test")]

mod curves;
mod detail;
mod hostile;
mod meaning;
mod messages;
mod time;
