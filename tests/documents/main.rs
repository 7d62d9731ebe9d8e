//! The documents: links lead somewhere, lengths stay within limits, the book is complete, the README keeps its commands.

mod book;
mod lengths;
mod links;
mod markdown;
