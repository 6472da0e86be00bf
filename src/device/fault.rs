//! Fault injection: makes a device fail at a chosen dispatch, so that the promises about failing devices can be tested.

use std::fmt::{Display, Formatter};
use std::str::FromStr;

/// A fault to inject, once. Dispatches, which are submissions of bundles, are numbered from 1, over all scenes of a
/// device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Fault {
    /// The device is lost while the dispatch is under way, as after a driver reset.
    Lost(u64),
    /// The dispatch never returns.
    Hang(u64),
    /// The dispatch returns wrong hits.
    Corrupt(u64),
    /// The device has no memory for the scene.
    OutOfMemory,
    /// The device refuses the kernels.
    Refused,
    /// Fused multiply-adds have another last bit in some cases.
    Inexact,
}

/// A text that names no fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "there is no fault {0:?}; write gpu-lost@N, gpu-hang@N or gpu-corrupt@N, where N is the dispatch at which it \
     happens, from 1; or gpu-oom, gpu-refused or gpu-inexact"
)]
pub struct NoSuchFault(String);

impl FromStr for Fault {
    type Err = NoSuchFault;

    fn from_str(text: &str) -> Result<Self, NoSuchFault> {
        let error = || NoSuchFault(text.to_owned());
        let Some((name, at)) = text.split_once('@') else {
            return match text {
                "gpu-oom" => Ok(Self::OutOfMemory),
                "gpu-refused" => Ok(Self::Refused),
                "gpu-inexact" => Ok(Self::Inexact),
                _ => Err(error()),
            };
        };
        let at = at.parse().ok().filter(|&n: &u64| n > 0).ok_or_else(error)?;
        match name {
            "gpu-lost" => Ok(Self::Lost(at)),
            "gpu-hang" => Ok(Self::Hang(at)),
            "gpu-corrupt" => Ok(Self::Corrupt(at)),
            _ => Err(error()),
        }
    }
}

impl Fault {
    /// The number of the dispatch at which the fault happens.
    pub(super) fn dispatch(self) -> Option<u64> {
        match self {
            Self::Lost(at) | Self::Hang(at) | Self::Corrupt(at) => Some(at),
            _ => None,
        }
    }
}

/// The name that is parsed.
impl Display for Fault {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Lost(at) => write!(f, "gpu-lost@{at}"),
            Self::Hang(at) => write!(f, "gpu-hang@{at}"),
            Self::Corrupt(at) => write!(f, "gpu-corrupt@{at}"),
            Self::OutOfMemory => f.write_str("gpu-oom"),
            Self::Refused => f.write_str("gpu-refused"),
            Self::Inexact => f.write_str("gpu-inexact"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_parsed_from_their_names() {
        assert_eq!("gpu-lost@1".parse(), Ok(Fault::Lost(1)));
        assert_eq!("gpu-hang@20".parse(), Ok(Fault::Hang(20)));
        assert_eq!("gpu-corrupt@3".parse(), Ok(Fault::Corrupt(3)));
        assert_eq!("gpu-oom".parse(), Ok(Fault::OutOfMemory));
        for bad in
            ["", "gpu", "gpu-oom@1", "gpu-lost", "gpu-lost@", "gpu-lost@0", "gpu-lost@-1", "gpu-melt@1"]
        {
            let error = bad.parse::<Fault>().expect_err(bad).to_string();
            assert!(error.contains(&format!("{bad:?}")) && error.contains("gpu-corrupt@N"), "{error}");
        }
        for fault in [
            Fault::Lost(7),
            Fault::Hang(1),
            Fault::Corrupt(2),
            Fault::OutOfMemory,
            Fault::Refused,
            Fault::Inexact,
        ] {
            assert_eq!(fault.to_string().parse(), Ok(fault));
        }
    }
}
