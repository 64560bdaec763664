//! From settings to a predictor.

use std::sync::Arc;

use pellucid_core::{Fault, Team};
use pellucid_predict::{MonteCarlo, Object, PredictError, Predictor, Shared, WithGradient};
use pellucid_voxel::MaterialTable;

use crate::{GradientKind, PredictorKind, PrintError, PrintSettings, StrategyKind};

/// Coefficients that exceed the trained range by less are taken for equal.
#[cfg(feature = "rpnn")]
const SLACK: f64 = 1.01;

/// A team's path tracer with `spp` paths a point and channel.
pub(crate) fn monte_carlo(
    settings: &PrintSettings,
    spp: u32,
    team: &Arc<dyn Team>,
) -> Result<Shared<MonteCarlo>, PrintError> {
    Ok(Shared::new(own_paths(settings, spp)?, Arc::clone(team)))
}

fn own_paths(settings: &PrintSettings, spp: u32) -> Result<MonteCarlo, PrintError> {
    let mut tracer = MonteCarlo::new(spp)?;
    if let Some(set) = settings.instruction_set {
        tracer = tracer.with_instruction_set(set)?;
    }
    Ok(tracer)
}

/// The predictor that settings name, with the gradient that their strategy needs; the path tracer where an object has
/// to decide. What takes time in it is the team's.
pub(crate) fn predictor(
    settings: &PrintSettings,
    team: &Arc<dyn Team>,
) -> Result<Arc<dyn Predictor>, PrintError> {
    let mut tracer = own_paths(settings, settings.spp.unwrap_or(settings.strategy.spp()))?;
    if settings.strategy == StrategyKind::Descent {
        tracer = tracer.with_pooled_adjoint().with_adjoint_paths(gradient_paths(settings))?;
    }
    let tracer = Shared::new(tracer, Arc::clone(team));
    let values: Arc<dyn Predictor> = match settings.predictor {
        PredictorKind::MonteCarlo | PredictorKind::Auto => Arc::new(tracer.clone()),
        PredictorKind::Rpnn => with_paths(settings, tracer.clone(), team)?,
    };
    let by_paths = settings.predictor != PredictorKind::Rpnn;
    match (settings.strategy, settings.gradient) {
        (StrategyKind::SurfaceFirst | StrategyKind::SurfaceColor, _) => Ok(values),
        (StrategyKind::Descent, GradientKind::Paths) if by_paths => Ok(values),
        (StrategyKind::Descent, GradientKind::Paths) => Ok(Arc::new(WithGradient::new(values, tracer))),
        (StrategyKind::Descent, GradientKind::Network) => {
            Ok(Arc::new(WithGradient::new(values, network(settings, team)?)))
        }
    }
}

/// Paths of the derivative a point and channel: its noise adds up over channels, so that more of them need fewer each.
fn gradient_paths(settings: &PrintSettings) -> f32 {
    settings.gradient_spp * (3.0 / settings.materials.channels() as f32).min(1.0)
}

/// The network with what paths take out of its error.
#[cfg(feature = "rpnn")]
fn with_paths(
    settings: &PrintSettings,
    tracer: Shared<MonteCarlo>,
    team: &Arc<dyn Team>,
) -> Result<Arc<dyn Predictor>, PrintError> {
    use pellucid_predict::{Averaged, Corrected};

    let network = network(settings, team)?;
    Ok(match settings.strategy {
        StrategyKind::Descent => Arc::new(Averaged::new(network, tracer, settings.newest)?),
        StrategyKind::SurfaceFirst | StrategyKind::SurfaceColor => {
            Arc::new(Corrected::new(network, tracer, settings.correction)?)
        }
    })
}

#[cfg(not(feature = "rpnn"))]
fn with_paths(
    _: &PrintSettings,
    _: Shared<MonteCarlo>,
    _: &Arc<dyn Team>,
) -> Result<Arc<dyn Predictor>, PrintError> {
    Err(no_network("this build has no network; build with the feature \"weights\""))
}

#[cfg(not(feature = "rpnn"))]
pub(crate) fn network(_: &PrintSettings, _: &Arc<dyn Team>) -> Result<Arc<dyn Predictor>, PrintError> {
    Err(no_network("this build has no network's gradient; build with the feature \"weights\""))
}

/// The network alone: what the report compares with the judge's paths.
#[cfg(feature = "rpnn")]
pub(crate) fn network(
    settings: &PrintSettings,
    team: &Arc<dyn Team>,
) -> Result<Arc<dyn Predictor>, PrintError> {
    let network = on_own_kernels(settings)?;
    let network: Arc<dyn Predictor> = match settings.device {
        None => Arc::new(network),
        Some(device) => in_candle(settings, &network, device)?,
    };
    Ok(Arc::new(Shared::new(network, Arc::clone(team))))
}

/// Makes a predictor of settings, whose work a team shares out.
pub(crate) type Make = fn(&PrintSettings, &Arc<dyn Team>) -> Result<Arc<dyn Predictor>, PrintError>;

/// What `make` makes of the settings by means of the network, if that was trained for such an object; else why it does not
/// fit.
pub(crate) fn fitting(
    settings: &PrintSettings,
    object: &Object,
    team: &Arc<dyn Team>,
    make: Make,
) -> Result<Result<Arc<dyn Predictor>, Fault>, PrintError> {
    let made = || {
        let made = make(settings, team)?;
        made.supports(object)?;
        check_range(settings, object.materials())?;
        Ok(made)
    };
    match made() {
        Err(PrintError::Unsupported(fault) | PrintError::Predict(PredictError::Unsupported(fault))) => {
            Ok(Err(fault))
        }
        other => other.map(Ok),
    }
}

/// Tells whether the network was trained with coefficients as far apart as those of the materials.
#[cfg(feature = "rpnn")]
fn check_range(settings: &PrintSettings, materials: &MaterialTable) -> Result<(), PrintError> {
    let network = on_own_kernels(settings)?;
    let trained = &network.trained().provenance;
    for material in materials.materials() {
        let coefficients = [
            ("scattering", &material.sigma_s, trained.sigma_s_range),
            ("absorption", &material.sigma_a, trained.sigma_a_range),
        ];
        for (what, values, [least, most]) in coefficients {
            let outside = |v: &&f32| !(least / SLACK..=most * SLACK).contains(&f64::from(**v));
            if let Some(value) = values.iter().find(outside) {
                let reason = format!("{value} per mm; the network was trained for {least:.4} to {most:.1}");
                let subject = format!("{what} of {:?}", material.name);
                return Err(PrintError::Unsupported(Fault::new(subject, reason)));
            }
        }
    }
    Ok(())
}

#[cfg(not(feature = "rpnn"))]
fn check_range(_: &PrintSettings, _: &MaterialTable) -> Result<(), PrintError> {
    Err(no_network("this build has no network; build with the feature \"weights\""))
}

#[cfg(feature = "candle")]
fn in_candle(
    settings: &PrintSettings,
    network: &pellucid_predict::Network,
    device: pellucid_predict::NetworkDevice,
) -> Result<Arc<dyn Predictor>, PrintError> {
    use pellucid_predict::CandleNetwork;
    use pellucid_rpnn::Precision;

    let mut network = CandleNetwork::new(network.trained().clone(), device.open()?, Precision::F32)?;
    if let Some(set) = settings.instruction_set {
        network = network.with_instruction_set(set)?;
    }
    Ok(Arc::new(network.with_sharing(settings.sharing)?))
}

#[cfg(all(feature = "rpnn", not(feature = "candle")))]
fn in_candle(
    _: &PrintSettings,
    network: &pellucid_predict::Network,
    device: pellucid_predict::NetworkDevice,
) -> Result<Arc<dyn Predictor>, PrintError> {
    // Without candle no device is built in.
    device.check()?;
    Ok(Arc::new(network.clone()))
}

#[cfg(feature = "rpnn")]
fn on_own_kernels(settings: &PrintSettings) -> Result<pellucid_predict::Network, PrintError> {
    use pellucid_predict::Network;
    use pellucid_rpnn::Precision;

    let network = match &settings.weights {
        Some(given) => Network::new(given.trained.clone(), Precision::Bf16),
        #[cfg(feature = "weights")]
        None => Network::shipped()?,
        #[cfg(not(feature = "weights"))]
        None => {
            return Err(no_network(
                "this build carries no weights; give some, or build with the feature \"weights\"",
            ));
        }
    };
    let pitch = settings.printer.pitch().mm();
    network.trained().provenance.check(pitch, settings.refractive_index).map_err(PredictError::from)?;
    let mut network = network.with_sharing_where_possible(settings.sharing)?;
    if let Some(set) = settings.instruction_set {
        network = network.with_instruction_set(set)?;
    }
    Ok(network)
}

#[cfg(not(feature = "weights"))]
fn no_network(reason: &str) -> PrintError {
    PrintError::Unsupported(Fault::new("predictor", reason))
}
