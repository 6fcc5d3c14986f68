//! How a stage tells the outside how far it is. The library never prints.

/// Receives the progress of stages. All methods may be called from any thread.
pub trait Observer: Sync {
    /// A stage of `total` equal steps begins; `what` is a short noun phrase ("visibility graph").
    fn begin(&self, what: &str, total: u64);
    /// `steps` more are done.
    fn advance(&self, steps: u64);
    /// The stage is over.
    fn end(&self);
}

/// Hears everything and says nothing.
pub struct Silent;

impl Observer for Silent {
    fn begin(&self, _what: &str, _total: u64) {}
    fn advance(&self, _steps: u64) {}
    fn end(&self) {}
}
