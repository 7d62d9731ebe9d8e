//! Report: what a person opens after a run.
