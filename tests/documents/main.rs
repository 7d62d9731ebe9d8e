//! The documents: links lead somewhere, lengths stay within limits, the book is complete, the README keeps its commands, and
//! words are those of the field.

mod book;
mod lengths;
mod links;
mod markdown;
mod words;
