//! Keeping signals of many manoeuvres while they fly.

use crate::config::mission::ValidMission;
use crate::config::scenario::{Scenario, ValidScenario};
use crate::error::ConfigError;
use crate::hardware::sensors::{MEASURED_NAMES, OUTPUTS};
use crate::interruption;
use crate::memory;
use crate::simd::mask::everyone;
use crate::simd::mask::lanes_of;
use crate::simd::{Laned, Number};
use crate::simulation::Flight;
use crate::simulation::course::Origin;
use crate::simulation::hook::StepHook;
use crate::simulation::loads::{
    Before, LOAD_NAMES, LoadMeter, LoadMetrics, LoadSums, Loads, move_loads,
};

use super::trajectory::{
    MAX_BYTES, Row, SIGNAL_NAMES, apply_torques, last_row, move_row, signals_of, torques_of,
};

/// Where a column comes from, and its place there.
#[derive(Debug, Clone, Copy)]
enum Column {
    Signal(usize),
    Load(usize),
    Measured(usize),
}

/// What stands in a column: the signals, behind them the loads, then what is measured.
fn origin_of(column: usize) -> Column {
    const LOADS: usize = SIGNAL_NAMES.len();
    const MEASURED: usize = LOADS + LOAD_NAMES.len();
    match column {
        ..LOADS => Column::Signal(column),
        LOADS..MEASURED => Column::Load(column - LOADS),
        _ => Column::Measured(column - MEASURED),
    }
}

fn column_name(column: usize) -> &'static str {
    match origin_of(column) {
        Column::Signal(i) => SIGNAL_NAMES[i],
        Column::Load(i) => LOAD_NAMES[i],
        Column::Measured(i) => MEASURED_NAMES[i],
    }
}

/// What is kept of one manoeuvre beside the signals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Beside {
    /// The loads, with their peaks and root mean squares.
    pub loads: bool,
    /// What is measured, see [`MEASURED_NAMES`].
    pub measured: bool,
}

impl Beside {
    /// Names of the signals and of what is kept beside them, in order; what is both is a signal.
    pub(super) fn names(self) -> Vec<&'static str> {
        let loads = if self.loads { &LOAD_NAMES[..] } else { &[] };
        let measured = if self.measured {
            &MEASURED_NAMES[..]
        } else {
            &[]
        };
        let more = loads.iter().filter(|name| !SIGNAL_NAMES.contains(name));
        let all = SIGNAL_NAMES.iter().chain(more).chain(measured);
        all.copied().collect()
    }

    /// Keeps all of it, every `every`-th sample.
    ///
    /// # Errors
    /// `every` of 0.
    pub(super) fn recording(self, every: usize) -> Result<Recording, ConfigError> {
        let recording = Recording::new(&self.names(), every)?;
        Ok(if self.loads {
            recording.with_loads()
        } else {
            recording
        })
    }
}

/// Names of everything that can be kept.
pub fn recordable() -> Vec<&'static str> {
    let all = Beside {
        loads: true,
        measured: true,
    };
    all.names()
}

/// Numbers that are written between two looks whether the work shall stop.
const NUMBERS_BETWEEN_POLLS: usize = 1 << 20;

/// Which signals of each manoeuvre are kept, and how often.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    /// Places in [`SIGNAL_NAMES`], behind them in [`LOAD_NAMES`], and behind these in [`MEASURED_NAMES`].
    columns: Vec<usize>,
    every: usize,
    /// Whether peaks and mean squares of the loads are wanted.
    loads: bool,
}

impl Recording {
    /// Keeps signals by name every `every` samples of the sample period, the first and the last
    /// sample included.
    ///
    /// # Errors
    /// A signal that does not exist or is named twice; `every` of 0.
    pub fn new<S: AsRef<str>>(signals: &[S], every: usize) -> Result<Self, ConfigError> {
        if every == 0 {
            return Err(ConfigError::value(
                "decimation",
                "must be at least 1",
                every,
            ));
        }
        let mut columns = Vec::with_capacity(signals.len());
        for (index, name) in signals.iter().map(AsRef::as_ref).enumerate() {
            let path = format!("signals[{index}]");
            let mut known = SIGNAL_NAMES
                .iter()
                .chain(&LOAD_NAMES)
                .chain(&MEASURED_NAMES);
            let Some(column) = known.position(|known| *known == name) else {
                let requirement = format!("must be one of {}", recordable().join(", "));
                return Err(ConfigError::value(path, requirement, name));
            };
            if columns.contains(&column) {
                return Err(ConfigError::value(path, "must be named once", name));
            }
            columns.push(column);
        }
        Ok(Self {
            columns,
            every,
            loads: false,
        })
    }

    /// The same, with peaks and mean squares of the loads over all samples.
    #[must_use]
    pub fn with_loads(self) -> Self {
        Self {
            loads: true,
            ..self
        }
    }

    /// Whether peaks and mean squares of the loads are wanted.
    pub(super) fn measures_loads(&self) -> bool {
        self.loads
    }

    /// Whether loads are to be computed at all.
    fn needs_loads(&self) -> bool {
        self.loads
            || self
                .columns
                .iter()
                .any(|column| matches!(origin_of(*column), Column::Load(_)))
    }

    /// Rows of a manoeuvre that is not cut short.
    fn rows(&self, scenario: &Scenario) -> usize {
        scenario.samples().div_ceil(self.every) + 1
    }

    /// Refuses rows that do not fall on the beginnings of the legs of missions.
    pub(super) fn check_missions(&self, missions: &[ValidMission]) -> Result<(), ConfigError> {
        let mut periods = missions.iter().map(ValidMission::period);
        match periods.find(|period| !period.is_multiple_of(self.every as u64)) {
            None => Ok(()),
            Some(period) => {
                let requirement = format!("must divide the {period} samples of mission.period");
                Err(ConfigError::value("decimation", requirement, self.every))
            }
        }
    }
}

/// Signals of many manoeuvres.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectories {
    /// Rows kept of the longest manoeuvre.
    pub samples: usize,
    /// Names with their values, SI, angles in radians: manoeuvres x `samples`, manoeuvre by
    /// manoeuvre, NaN after the end of each.
    pub signals: Vec<(&'static str, Vec<f64>)>,
}

impl Trajectories {
    /// Room for the signals of these manoeuvres.
    ///
    /// # Errors
    /// More than [`MAX_BYTES`], or more than the system gives.
    pub(super) fn new(
        recording: &Recording,
        scenarios: &[ValidScenario],
    ) -> Result<Self, ConfigError> {
        let rows = scenarios.iter().map(|scenario| recording.rows(scenario));
        let samples = rows.max().unwrap_or(0);
        let numbers = scenarios.len() as u128 * samples as u128;
        let bytes = numbers * recording.columns.len() as u128 * size_of::<f64>() as u128;
        let (columns, flown) = (recording.columns.len(), scenarios.len());
        let given = format!("{columns} of {flown} manoeuvres");
        let less = "fewer of them, fewer scenarios or a larger decimation";
        memory::check("signals", given, bytes, Some(MAX_BYTES), less)?;
        let numbers = numbers as usize;
        let mut signals = Vec::with_capacity(recording.columns.len());
        for column in &recording.columns {
            let mut values = Vec::with_capacity(numbers);
            while values.len() < numbers {
                interruption::poll();
                values.resize(numbers.min(values.len() + NUMBERS_BETWEEN_POLLS), f64::NAN);
            }
            signals.push((column_name(*column), values));
        }
        Ok(Self { samples, signals })
    }

    /// Takes the rows of one manoeuvre.
    pub(super) fn put(&mut self, index: usize, rows: &[f64]) {
        let count = self.signals.len();
        for (column, (_, values)) in self.signals.iter_mut().enumerate() {
            let kept = rows.iter().skip(column).step_by(count.max(1));
            for (slot, value) in values[index * self.samples..].iter_mut().zip(kept) {
                *slot = *value;
            }
        }
    }
}

/// What is kept of a manoeuvre that has ended.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Kept {
    /// Rows of the signals, one after the other.
    pub(super) rows: Vec<f64>,
    /// Loads, if they are wanted.
    pub(super) loads: Option<LoadMetrics>,
}

/// The loads of one lane.
#[derive(Debug, Clone)]
struct Loaded {
    meter: LoadMeter,
    open: Option<Before>,
    sums: LoadSums,
}

/// Keeps the rows of manoeuvres that fly side by side.
pub(super) struct Recorder<'a> {
    recording: &'a Recording,
    /// The rows of each lane, one after the other.
    kept: Vec<Vec<f64>>,
    /// Rows whose torques are not known yet, and their lanes, a bit each.
    open: Vec<(Row, [f64; OUTPUTS])>,
    opened: u32,
    /// Samples in which no lane has a row.
    quiet: usize,
    /// Where the legs of missions in the lanes have begun.
    origins: Vec<Option<Origin>>,
    /// Loads of each lane, from its first sample on.
    loaded: Vec<Option<Box<Loaded>>>,
}

impl<'a> Recorder<'a> {
    /// For so many lanes.
    pub(super) fn new(recording: &'a Recording, lanes: usize) -> Self {
        Self {
            recording,
            kept: vec![Vec::new(); lanes],
            open: vec![([0.0; SIGNAL_NAMES.len()], [0.0; OUTPUTS]); lanes],
            opened: 0,
            quiet: 0,
            origins: vec![None; lanes],
            loaded: vec![None; lanes],
        }
    }

    /// Other lanes fly from now on.
    pub(super) fn look_again(&mut self) {
        self.quiet = 0;
    }

    /// A leg of a mission begins in a lane.
    pub(super) fn begin_leg<T: Number>(&mut self, flight: &Flight<T>, lane: usize, origin: Origin) {
        self.origins[lane] = Some(origin);
        if let Some(loaded) = &mut self.loaded[lane] {
            // another plan, perhaps another payload
            loaded.open = None;
            if let Some(meter) = LoadMeter::of(flight, lane) {
                loaded.meter = meter;
            }
        }
    }

    /// The rows of a lane that has ended, which are forgotten; see [`last_row`] for `driven`. A state
    /// beyond the limits of [`crate::validity`] has no row.
    pub(super) fn end<T: Number>(&mut self, flight: &Flight<T>, lane: usize, driven: bool) -> Kept {
        let void = flight.void() >> lane & 1 == 1;
        self.opened &= !(1 << lane);
        if !void {
            let row = last_row(flight, lane, driven);
            self.open_loads(flight, lane);
            let loads = self.close_loads(lane, torques_of(&row));
            let measured = flight.all_measured_in(lane);
            self.keep(lane, &(row, measured), loads.as_ref());
        }
        self.origins[lane] = None;
        let loaded = self.loaded[lane].take();
        Kept {
            rows: std::mem::take(&mut self.kept[lane]),
            loads: self.recording.loads.then(|| match loaded {
                Some(loaded) if !void => loaded.sums.metrics(),
                _ => LoadMetrics::VOID,
            }),
        }
    }

    fn keep(&mut self, lane: usize, seen: &(Row, [f64; OUTPUTS]), loads: Option<&Loads>) {
        let (mut row, mut measured) = *seen;
        if let Some(origin) = self.origins[lane] {
            move_row(&mut row, (origin.time, origin.angle));
            measured[0] += origin.angle;
        }
        let value = |column: &usize| match origin_of(*column) {
            Column::Signal(i) => row[i],
            Column::Load(i) => loads.map_or(f64::NAN, |loads| loads[i]),
            Column::Measured(i) => measured[i],
        };
        self.kept[lane].extend(self.recording.columns.iter().map(value));
    }

    /// Looks at a lane before its torques are known.
    fn open_loads<T: Number>(&mut self, flight: &Flight<T>, lane: usize) {
        if !self.recording.needs_loads() {
            return;
        }
        if self.loaded[lane].is_none() {
            self.loaded[lane] = LoadMeter::of(flight, lane).map(|meter| {
                let sums = LoadSums::NONE;
                let open = None;
                Box::new(Loaded { meter, open, sums })
            });
        }
        if let Some(loaded) = &mut self.loaded[lane] {
            loaded.open = Some(loaded.meter.look(flight, lane));
        }
    }

    /// The loads of a lane that has been looked at, with its torques.
    fn close_loads(&mut self, lane: usize, torques: [f64; 3]) -> Option<Loads> {
        let loaded = self.loaded[lane].as_mut()?;
        let mut loads = loaded.meter.at(&loaded.open.take()?, torques);
        if let Some(origin) = self.origins[lane] {
            move_loads(&mut loads, origin.angle + origin.base, origin.energy);
        }
        loaded.sums.take(&loads);
        Some(loads)
    }
}

impl<T: Number> StepHook<T> for Recorder<'_> {
    fn before(&mut self, flight: &Flight<T>) {
        if self.quiet > 0 {
            self.quiet -= 1;
            return;
        }
        let every = self.recording.every;
        let mut next = every;
        for lane in lanes_of(everyone::<T>() & !flight.resting()) {
            let past = flight.common.sample.lane(lane) as usize % every;
            if past == 0 {
                let row = signals_of(flight, lane, [0.0; 3]);
                self.open[lane] = (row, flight.all_measured_in(lane));
                self.opened |= 1 << lane;
            }
            if past == 0 || self.recording.loads {
                self.open_loads(flight, lane);
            }
            next = next.min(every - past);
        }
        self.quiet = if self.recording.loads { 0 } else { next - 1 };
    }

    fn after(&mut self, flight: &Flight<T>) {
        let opened = std::mem::take(&mut self.opened);
        let measured = if self.recording.loads {
            everyone::<T>() & !flight.resting()
        } else {
            0
        };
        for lane in lanes_of(opened | measured) {
            // the torques of a row are those applied from it on
            let torques = flight.common.torques.lane_of(lane);
            let loads = self.close_loads(lane, torques);
            if opened >> lane & 1 == 1 {
                let (mut row, measured) = self.open[lane];
                apply_torques(&mut row, flight, lane, torques);
                self.keep(lane, &(row, measured), loads.as_ref());
            }
        }
    }
}
