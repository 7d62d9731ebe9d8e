//! The radiance field against vectors of an independent implementation, closed forms and central differences.

mod claimed;
mod dynamics;
mod examples;
mod falling;
mod grids;
mod harness;
mod losses;
mod rendering;
mod seeding;
mod steps;
mod temporal;
