//! Why the GPU cannot be used. The caller goes on with the CPU.

/// Why a GPU cannot be opened or cannot take a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// No driver, or no device.
    #[error("no GPU adapter: no usable {backends} driver or device found; install one or trace on the CPU")]
    NoAdapter {
        /// The interfaces that were asked.
        backends: String,
    },
    /// Only software adapters, which are used when asked for.
    #[error("no hardware GPU adapter, only software: {found}; ask for one by name to use it")]
    OnlySoftware {
        /// The adapters there are.
        found: String,
    },
    /// No adapter has the wanted name.
    #[error("no GPU adapter is called {wanted:?}; there is: {found}")]
    NoSuchAdapter {
        /// Part of the name that was asked for.
        wanted: String,
        /// The adapters there are.
        found: String,
    },
    /// The adapter is there, but does not give a device.
    #[error("the GPU {adapter} cannot be opened: {reason}")]
    Open {
        /// The adapter's name.
        adapter: String,
        /// What the driver said.
        reason: String,
    },
    /// The adapter's arithmetic is not what the kernels' error bounds assume.
    #[error("the GPU {adapter} cannot be used: {reason}; trace on the CPU")]
    Arithmetic {
        /// The adapter's name.
        adapter: String,
        /// What it computed.
        reason: String,
    },
    /// The scene exceeds what the adapter can bind, all bindings together.
    #[error(
        "the scene needs {required} bytes on the GPU, but {adapter} binds at most {available}; trace on the CPU"
    )]
    TooLarge {
        /// Its nodes and triangles, in bytes.
        required: u64,
        /// What the adapter's bindings take in bytes.
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
        /// What the driver said.
        reason: String,
    },
    /// A kernel was refused.
    #[error("the GPU {adapter} refuses a kernel: {reason}")]
    KernelKind {
        /// The adapter's name.
        adapter: String,
        /// What the driver said.
        reason: String,
    },
    /// The device was lost meanwhile.
    #[error("the GPU was lost: {0}")]
    Lost(String),
}
