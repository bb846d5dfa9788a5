//! Which light is followed, and for how long.

use std::time::Duration;

use clap::{Args, ValueEnum};

use super::voxels;
use crate::cli::{Failure, text};
use crate::march::{Film, Integrator, Shadow};

/// Passes before which no estimate of the noise is believed.
const LEAST_PASSES: u32 = 8;
/// Rays through every pixel at most.
const MOST_SAMPLES: u32 = 1_000_000;

#[derive(Debug, Args)]
pub(super) struct LightOptions {
    /// Rays through every pixel, or, with a limit, no more than so many [default: 1; with a limit, 1000000]
    #[arg(long, value_name = "N", value_parser = text::whole(1, MOST_SAMPLES), allow_negative_numbers = true)]
    samples: Option<u32>,
    /// `single`: light that is scattered once, and ambient light unshadowed; `path`: all light, by random paths
    #[arg(long, value_enum, default_value_t = Kind::Single)]
    integrator: Kind,
    /// Of paths: another seed gives other noise [default: 0]
    #[arg(long, value_name = "N", value_parser = text::whole(0, u64::MAX), allow_negative_numbers = true)]
    seed: Option<u64>,
    /// How shadows are found, where light is scattered once: from a table, or by a ray from every sample to every lamp; `none`
    /// leaves them out
    #[arg(long, value_enum)]
    shadow: Option<ShadowKind>,
    /// Of cached shadows: voxels between the rays that they are found by [default: 2]
    #[arg(long, value_name = "VOXELS", value_parser = voxels, allow_hyphen_values = true)]
    shadow_step: Option<f64>,
    /// Stop once this time is over, and give up the pass that is under way then unless it is the first: how many passes that are
    /// depends on the machine
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_hyphen_values = true)]
    time_limit: Option<Duration>,
    /// Of paths: stop after the pass after which the mean standard error is below this part of the mean luminance
    #[arg(long, value_name = "PART", value_parser = noise, allow_hyphen_values = true)]
    noise_limit: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    Single,
    Path,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ShadowKind {
    Cached,
    Exact,
    None,
}

impl LightOptions {
    /// That no option is given which has no meaning.
    pub(super) fn check(&self) -> Result<(), Failure> {
        let is_path = self.integrator == Kind::Path;
        let for_paths = [("--seed", self.seed.is_some()), ("--noise-limit", self.noise_limit.is_some())];
        let for_single = [("--shadow", self.shadow.is_some()), ("--shadow-step", self.shadow_step.is_some())];
        let (options, own) = if is_path { (for_single, "single") } else { (for_paths, "path") };
        if let Some((option, _)) = options.into_iter().find(|(_, given)| *given) {
            return Err(Failure::usage(format!("{option} has a meaning only with --integrator {own}")));
        }
        let uncached = match self.shadow {
            Some(ShadowKind::Exact) => Some("exact"),
            Some(ShadowKind::None) => Some("none"),
            Some(ShadowKind::Cached) | None => None,
        };
        if let Some(uncached) = uncached.filter(|_| self.shadow_step.is_some()) {
            return Err(Failure::usage(format!("--shadow-step has no meaning with --shadow {uncached}")));
        }
        Ok(())
    }

    /// Whether it was chosen how shadows are found.
    pub(super) fn has_shadow(&self) -> bool {
        self.shadow.is_some() || self.shadow_step.is_some()
    }

    /// Whether shadows are found before and kept.
    pub(super) fn keeps_shadows(&self) -> bool {
        self.integrator() == Integrator::Single && matches!(self.shadow(), Shadow::Cached(_))
    }

    pub(super) fn integrator(&self) -> Integrator {
        match self.integrator {
            Kind::Single => Integrator::Single,
            Kind::Path => Integrator::Path { seed: self.seed.unwrap_or(0) },
        }
    }

    pub(super) fn shadow(&self) -> Shadow {
        match self.shadow {
            Some(ShadowKind::Exact) => Shadow::Exact,
            Some(ShadowKind::None) => Shadow::None,
            _ => Shadow::Cached(self.shadow_step.unwrap_or(2.0)),
        }
    }

    /// Samples of every pixel at most.
    pub(super) fn samples(&self) -> u32 {
        let is_limited = self.time_limit.is_some() || self.noise_limit.is_some();
        self.samples.unwrap_or(if is_limited { MOST_SAMPLES } else { 1 })
    }

    /// Whether there is enough, so long after the beginning.
    pub(super) fn is_enough(&self, film: &Film, after: Duration) -> bool {
        let is_clear = self.noise_limit.is_some_and(|limit| {
            film.samples >= LEAST_PASSES && film.noise().is_none_or(|noise| noise <= limit)
        });
        self.is_late(after) || is_clear
    }

    /// Whether the time is over, so long after the beginning.
    pub(super) fn is_late(&self, after: Duration) -> bool {
        self.time_limit.is_some_and(|limit| after >= limit)
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=1e9).contains(seconds));
    seconds
        .map(Duration::from_secs_f64)
        .ok_or_else(|| "expected a number of seconds from 0 to 1e9".to_owned())
}

fn noise(text: &str) -> Result<f64, String> {
    let noise = text.parse().ok().filter(|noise| (1e-9..=1e9).contains(noise));
    noise.ok_or_else(|| "expected a part from 1e-9 to 1e9".to_owned())
}
