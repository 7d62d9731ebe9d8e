//! What happens in a film: the object, its free flights and contacts.

pub(in crate::video::film) mod background;
pub(in crate::video::film) mod chain;
pub(in crate::video::film) mod components;
pub(in crate::video::film) mod flight;
pub(in crate::video::film) mod search;
pub(in crate::video::film) mod sequence;
