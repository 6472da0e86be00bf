//! Why a GPU cannot be used. The caller goes on with the CPU.

/// Why a GPU cannot be opened or cannot take a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No driver, or no device.
    #[error("no GPU adapter: no usable {backends} driver or device found; install one or trace on the CPU")]
    NoAdapter {
        /// The graphics interfaces that were tried.
        backends: String,
    },
    /// There are only software adapters, which are used only on request.
    #[error("no hardware GPU adapter, only software: {found}; ask for one by name to use it")]
    OnlySoftware {
        /// The adapters found.
        found: String,
    },
    /// No adapter has the wanted name.
    #[error("no GPU adapter is called {wanted:?}; there is: {found}")]
    NoSuchAdapter {
        /// The requested part of the name.
        wanted: String,
        /// The adapters found.
        found: String,
    },
    /// The adapter does not provide a device.
    #[error("the GPU {adapter} cannot be opened: {reason}")]
    Open {
        /// The adapter's name.
        adapter: String,
        /// The driver's message.
        reason: String,
    },
    /// The adapter's arithmetic is not what the kernels' error bounds assume.
    #[error("the GPU {adapter} cannot be used: {reason}; trace on the CPU")]
    Arithmetic {
        /// The adapter's name.
        adapter: String,
        /// What it computed wrongly.
        reason: String,
    },
    /// The scene exceeds what all bindings of the adapter can hold together.
    #[error(
        "the scene needs {required} bytes on the GPU, but {adapter} binds at most {available}; trace on the CPU"
    )]
    TooLarge {
        /// Bytes of the scene's nodes and triangles.
        required: u64,
        /// Bytes that the adapter's bindings hold.
        available: u64,
        /// The adapter's name.
        adapter: String,
    },
    /// The device has no room for the scene.
    #[error("the scene needs {required} bytes on the GPU {adapter}, which does not give them: {reason}")]
    OutOfMemory {
        /// Bytes needed.
        required: u64,
        /// The adapter's name.
        adapter: String,
        /// The driver's message.
        reason: String,
    },
    /// A kernel was refused.
    #[error("the GPU {adapter} refuses a kernel: {reason}")]
    Kernel {
        /// The adapter's name.
        adapter: String,
        /// The driver's message.
        reason: String,
    },
    /// The device was lost.
    #[error("the GPU was lost: {0}")]
    Lost(String),
}
