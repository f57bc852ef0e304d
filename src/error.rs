//! Everything that can go wrong, in one enum. Each message says what was given, what is allowed, and where.

/// An error of this crate. Python sees one exception class per variant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The scene or a setting is not valid.
    #[error("{0}")]
    Scene(String),
    /// The run needs more memory than there is.
    #[error("{0}")]
    VolumeTooLarge(String),
    /// There is no adapter that could run kernels.
    #[error("{0}")]
    NoAdapter(String),
    /// The GPU was lost while it worked.
    #[error("{0}")]
    DeviceLost(String),
    /// The run was stopped from outside before it had anything to show.
    #[error("the run was interrupted before its first batch was finished")]
    Interrupted,
    /// A bug or a limit of this crate, detected rather than silent.
    #[error("{0}")]
    Internal(String),
}

/// The result of a fallible call of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// A [`Error::Scene`] from a message.
pub fn scene_error<T>(message: impl Into<String>) -> Result<T> {
    Err(Error::Scene(message.into()))
}
