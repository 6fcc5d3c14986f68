//! The luxgraph command.
fn main() {}
