//! The thesis plant over a leg: equal Runge-Kutta steps within one piece of the timeline, under held
//! commands. The length is prescribed, so what depends on it is evaluated beside the chain of stages:
//! at the middle and the end of each step, for one environment alone several steps ahead.

use crate::simd::dispatch::{Work, variants};

use crate::hardware::reaction_wheel::{StepTorque, WheelState};
use crate::math::runge_kutta::{Derivative, Stage, rk4_step};
use crate::plant::thesis::{Constants, Prepared};
use crate::plant::{RigidInertia, Torques};
use crate::reference::Extension;
use crate::reference::timeline::Piece;
use crate::simd::{Lane, Laned, Number, Pack, laned};

/// One wheel over a leg.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WheelDrive<T> {
    pub(crate) command: T,
    /// 1 with a lag, 0 without.
    pub(crate) memory: T,
    /// What half a step leaves of a difference.
    pub(crate) decay: T,
    pub(crate) momentum_limit: T,
}

impl<T: Lane> WheelDrive<T> {
    /// Torque over the next step of length `h`. An `ideal` wheel has neither lag nor momentum limit;
    /// it gets the same bits by either way.
    #[inline(always)]
    pub(crate) fn step(&self, ideal: bool, state: &mut WheelState<T>, h: T) -> StepTorque<T> {
        if ideal {
            state.follow(self.command, h)
        } else {
            state.step(
                self.command,
                self.memory,
                self.decay,
                self.momentum_limit,
                h,
            )
        }
    }
}

/// What a leg may leave out. Written down where a leg is flown, the compiler leaves it out too.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Switches {
    pub(crate) axial_load: bool,
    pub(crate) particle_following: bool,
    /// Wheels without lag and momentum limit, in every lane.
    pub(crate) ideal_wheels: bool,
}

impl Switches {
    /// The default dynamics with ideal wheels.
    pub(crate) const USUAL: Self = Self {
        axial_load: true,
        particle_following: false,
        ideal_wheels: true,
    };
}

/// What is constant over a leg.
pub(crate) struct Segment<'a, T> {
    pub(crate) constants: &'a Constants<T>,
    pub(crate) inertia: &'a RigidInertia<T>,
    pub(crate) piece: &'a Piece<T>,
    /// Torque of the slew motor where an agent drives it; open loop without.
    pub(crate) slew: Option<T>,
    pub(crate) root: WheelDrive<T>,
    pub(crate) tip: WheelDrive<T>,
    /// Beginning and end in time since the piece's start, s.
    pub(crate) from: T,
    pub(crate) until: T,
    /// Step, s.
    pub(crate) h: T,
    pub(crate) steps: usize,
    /// Whether the length is fixed in every lane: then the matrices are those of the beginning.
    pub(crate) still: bool,
}

/// The equations of motion at one instant of the prescribed motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StageTerms<T> {
    prepared: Prepared<T>,
    slew: T,
}

laned!(StageTerms { prepared, slew });

/// The instant at the end of a leg, for the next one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FsalCache<T> {
    /// Whether the next leg begins there in the same piece.
    pub(crate) valid: bool,
    instant: StageTerms<T>,
}

impl<T: Number> FsalCache<T> {
    /// Nothing yet.
    #[inline(always)]
    pub(crate) fn nothing() -> Self {
        Self {
            valid: false,
            instant: StageTerms::spread(&StageTerms::<f64>::NONE),
        }
    }
}

impl StageTerms<f64> {
    const NONE: Self = Self {
        prepared: Prepared::ZERO,
        slew: 0.0,
    };
}

impl<T: Lane> StageTerms<T> {
    #[inline(always)]
    fn new(
        switches: Switches,
        constants: &Constants<T>,
        inertia: &RigidInertia<T>,
        piece: &Piece<T>,
        slew: Option<T>,
        u: T,
    ) -> Self {
        let extension = piece.extension(u);
        Self {
            prepared: Prepared::new(constants.matrices(
                &extension,
                switches.axial_load,
                switches.particle_following,
            )),
            slew: match slew {
                Some(torque) => torque,
                None => slew_torque(inertia, piece, &extension, u),
            },
        }
    }
}

/// Open-loop torque of the slew motor `u` seconds after the piece's start.
#[inline(always)]
pub(crate) fn slew_torque<T: Lane>(
    inertia: &RigidInertia<T>,
    piece: &Piece<T>,
    extension: &Extension<T>,
    u: T,
) -> T {
    let (accel, rate) = piece.motion(u);
    inertia.slew_torque(extension, rate, accel)
}

/// Steps whose instants are prepared together for one environment, two instants a step.
const STEPS_AHEAD: usize = 4;
const INSTANTS: usize = 2 * STEPS_AHEAD;

/// A place in a stack frame where registers of 64 bytes do not straddle cache lines.
#[repr(C, align(64))]
struct Anchor([u8; 64]);

impl<T: Number> Segment<'_, T> {
    /// Time since the piece's start of a number of steps and `part` of one more.
    #[inline(always)]
    fn place(&self, step: usize, part: f64) -> T {
        self.h.mul_add(T::splat(step as f64 + part), self.from)
    }

    /// The same of the end of a step; the last one ends where the leg does.
    #[inline(always)]
    fn end_of(&self, step: usize) -> T {
        if step + 1 == self.steps {
            self.until
        } else {
            self.place(step, 1.0)
        }
    }

    #[inline(always)]
    fn instant(&self, switches: Switches, u: T) -> StageTerms<T> {
        StageTerms::new(
            switches,
            self.constants,
            self.inertia,
            self.piece,
            self.slew,
            u,
        )
    }

    /// A later instant of a leg of fixed length.
    #[inline(always)]
    fn later(&self, now: &StageTerms<T>, u: T) -> StageTerms<T> {
        StageTerms {
            prepared: now.prepared,
            slew: match self.slew {
                Some(torque) => torque,
                None => slew_torque(self.inertia, self.piece, &self.piece.extension(u), u),
            },
        }
    }

    /// Advances the motion and the wheels; returns the torques at the beginning. `carried` holds the
    /// instant at the beginning if the leg before ended there in the same piece, and then that at the
    /// end.
    #[inline(always)]
    pub(crate) fn fly(
        &self,
        switches: Switches,
        motion: &mut [T; 6],
        root: &mut WheelState<T>,
        tip: &mut WheelState<T>,
        carried: &mut FsalCache<T>,
    ) -> Torques<T> {
        // aligns the frame, and with it the registers that are kept there
        std::hint::black_box(&mut Anchor([0; 64]));
        let mut now = if carried.valid {
            carried.instant
        } else {
            self.instant(switches, self.from)
        };
        let mut first = Torques {
            slew: now.slew,
            root: root.applied,
            tip: tip.applied,
        };
        if self.still {
            for step in 0..self.steps {
                let middle = self.later(&now, self.place(step, 0.5));
                let end = self.later(&now, self.end_of(step));
                let torques = self.step(switches, motion, [&now, &middle, &end], root, tip);
                if step == 0 {
                    (first.root, first.tip) = torques;
                }
                now = end;
            }
        } else if T::WIDTH == 1 {
            let constants = Constants::<Pack<INSTANTS>>::spread(&self.constants.lane_of(0));
            let inertia = RigidInertia::<Pack<INSTANTS>>::spread(&self.inertia.lane_of(0));
            let piece = Piece::<Pack<INSTANTS>>::spread(&self.piece.lane_of(0));
            let slew = self.slew.map(|torque| Pack::splat(torque.lane(0)));
            for begin in (0..self.steps).step_by(STEPS_AHEAD) {
                let mut places = [0.0; INSTANTS];
                for i in 0..STEPS_AHEAD {
                    places[2 * i] = self.place(begin + i, 0.5).lane(0);
                    places[2 * i + 1] = self.end_of(begin + i).lane(0);
                }
                let ahead =
                    StageTerms::new(switches, &constants, &inertia, &piece, slew, Pack(places));
                for i in 0..STEPS_AHEAD.min(self.steps - begin) {
                    let middle = StageTerms::spread(&ahead.lane_of(2 * i));
                    let end = StageTerms::spread(&ahead.lane_of(2 * i + 1));
                    let torques = self.step(switches, motion, [&now, &middle, &end], root, tip);
                    if begin + i == 0 {
                        (first.root, first.tip) = torques;
                    }
                    now = end;
                }
            }
        } else {
            for step in 0..self.steps {
                let middle = self.instant(switches, self.place(step, 0.5));
                let end = self.instant(switches, self.end_of(step));
                let torques = self.step(switches, motion, [&now, &middle, &end], root, tip);
                if step == 0 {
                    (first.root, first.tip) = torques;
                }
                now = end;
            }
        }
        *carried = FsalCache {
            valid: true,
            instant: now,
        };
        first
    }

    /// One Runge-Kutta step between three instants; returns root and tip torque at its beginning.
    #[inline(always)]
    fn step(
        &self,
        switches: Switches,
        motion: &mut [T; 6],
        instants: [&StageTerms<T>; 3],
        root: &mut WheelState<T>,
        tip: &mut WheelState<T>,
    ) -> (T, T) {
        let root = self.root.step(switches.ideal_wheels, root, self.h);
        let tip = self.tip.step(switches.ideal_wheels, tip, self.h);
        let slope = Slope {
            following: switches.particle_following,
            instants,
            root,
            tip,
        };
        *motion = rk4_step(motion, self.h, slope);
        (root.start, tip.start)
    }
}

/// Rates of the motion over one step.
struct Slope<'a, T> {
    following: bool,
    instants: [&'a StageTerms<T>; 3],
    root: StepTorque<T>,
    tip: StepTorque<T>,
}

impl<T: Lane> Derivative<T, 6> for Slope<'_, T> {
    #[inline(always)]
    fn at(&mut self, stage: Stage, y: &[T; 6]) -> [T; 6] {
        let [start, middle, end] = self.instants;
        let (instant, root, tip) = match stage {
            Stage::Start => (start, self.root.start, self.tip.start),
            Stage::Middle => (middle, self.root.middle, self.tip.middle),
            Stage::End => (end, self.root.end, self.tip.end),
        };
        let torques = Torques {
            slew: instant.slew,
            root,
            tip,
        };
        let [theta, alpha, beta, theta_rate, alpha_rate, beta_rate] = *y;
        let [a, b, c] = instant.prepared.acceleration(
            &[theta, alpha, beta],
            &[theta_rate, alpha_rate, beta_rate],
            &torques,
            self.following,
        );
        [theta_rate, alpha_rate, beta_rate, a, b, c]
    }
}

/// A leg of the thesis plant with any switches and wheels.
pub(super) struct General<'a, 'b, T: Number> {
    pub(super) leg: &'a Segment<'b, T>,
    pub(super) switches: Switches,
    pub(super) motion: &'a mut [T; 6],
    pub(super) root: &'a mut WheelState<T>,
    pub(super) tip: &'a mut WheelState<T>,
    pub(super) carried: &'a mut FsalCache<T>,
}

variants!(general);

impl<T: Number> Work for General<'_, '_, T> {
    type Output = crate::plant::Torques<T>;
    type Variants = general::Here;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self {
            leg,
            switches,
            motion,
            root,
            tip,
            carried,
        } = self;
        leg.fly(switches, motion, root, tip, carried)
    }
}
