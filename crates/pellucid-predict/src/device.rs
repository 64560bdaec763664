//! Where the network runs in candle.

/// A device of candle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum NetworkDevice {
    /// The processor.
    Cpu,
    /// The first NVIDIA GPU.
    Cuda,
    /// The first GPU of a Mac.
    Metal,
}

impl NetworkDevice {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Cpu, Self::Cuda, Self::Metal];

    /// The name in settings and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::Metal => "metal",
        }
    }

    /// The device of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|device| device.name() == name)
    }

    /// The cargo feature without which there is no such device.
    pub const fn feature(self) -> &'static str {
        match self {
            Self::Cpu => "candle",
            Self::Cuda => "cuda",
            Self::Metal => "metal",
        }
    }

    /// Whether this build has the feature.
    pub const fn built(self) -> bool {
        match self {
            Self::Cpu => cfg!(feature = "candle"),
            Self::Cuda => cfg!(feature = "cuda"),
            Self::Metal => cfg!(feature = "metal"),
        }
    }

    /// Whether this build can use the device.
    ///
    /// # Errors
    /// [`PredictError::Unsupported`](crate::PredictError::Unsupported) that names the feature to build with.
    pub fn check(self) -> Result<(), crate::PredictError> {
        match self.built() {
            true => Ok(()),
            false => Err(crate::PredictError::Unsupported(
                pellucid_core::Fault::new("device", format!("{}; this build cannot use it", self.name()))
                    .remedy(format!("build with the feature {:?}", self.feature())),
            )),
        }
    }

    /// Opens the device.
    ///
    /// # Errors
    /// As [`NetworkDevice::check`]; [`PredictError::Failed`](crate::PredictError::Failed) when the machine has none.
    #[cfg(feature = "candle")]
    pub fn open(self) -> Result<candle_core::Device, crate::PredictError> {
        use candle_core::Device;

        self.check()?;
        let opened = match self {
            Self::Cpu => Ok(Device::Cpu),
            Self::Cuda => Device::new_cuda(0),
            Self::Metal => Device::new_metal(0),
        };
        opened.map_err(|error| crate::PredictError::failed("rpnn", error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PredictError;

    #[test]
    fn a_device_that_was_not_built_in_is_refused_by_the_name_of_its_feature() {
        for device in NetworkDevice::ALL {
            assert_eq!(NetworkDevice::from_name(device.name()), Some(device));
            match device.check() {
                Ok(()) => assert!(device.built()),
                Err(PredictError::Unsupported(fault)) => {
                    assert!(!device.built());
                    assert!(fault.to_string().contains(&format!("{:?}", device.feature())), "{fault}");
                }
                Err(other) => panic!("{other}"),
            }
        }
        assert_eq!(NetworkDevice::from_name("tpu"), None);
    }
}
