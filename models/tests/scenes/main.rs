//! Scene files: the gallery, shapes and meshes, refused scenes, and the command.

mod bad_scenes;
mod command;
mod dialects;
mod filling;
mod gallery;
mod meshes;
mod own_laws;
mod thin;
