//! The program as it is used, and the files that it writes.

mod command;
mod export;
mod output_files;
mod target;
mod validate;
