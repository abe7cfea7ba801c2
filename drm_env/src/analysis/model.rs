//! The arm at one length for people who want its equations: matrices and the linear state-space form
//! of the plants that are flown (from the same code that steps), accelerations and energies of the
//! thesis' one, natural frequencies and mode shapes of these and of better models.

use nalgebra::{DMatrix, Matrix3, Rotation3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::analysis::linearization::{self, Equations, Linearization};
use crate::analysis::modal::spatial::Body;
use crate::analysis::modal::{
    AssumedArm, FiniteElementBeam, Kinematics, ModeShapes, SegmentedBeam, SpatialBeam,
    SpatialModes, UniformBeam, exact, finite_element, spatial,
};
use crate::arm::mode_shape::{MAX_SHAPES, ShapeFamily};
use crate::arm::{Arm, Payload, PayloadInertia, PayloadProperties};
use crate::check::{finite, positive};
use crate::error::ConfigError;
use crate::plant::consistent::{self, CAPACITY, ConsistentPlant};
use crate::plant::energy::{Energy, angular_momentum, energy};
use crate::plant::thesis::{Constants, Matrices, Prepared};
use crate::plant::{Dynamics, Torques};
use crate::reference::Extension;

/// What is known of the arm's bending.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelPlant {
    /// Assumed modes with the thesis' kinematics: the end of link 1 displaces link 2 but does not
    /// turn it. With one mode a link, the plant that is flown.
    #[default]
    Thesis,
    /// Assumed modes in which the end slope of link 1 turns link 2.
    Consistent,
    /// Beam finite elements of the whole arm.
    FiniteElement,
    /// The exact characteristic equation of the arm with rigid link 1.
    ExactRigidLink1,
    /// Finite elements of the whole arm in three dimensions: bending in the plane and out of it, torsion,
    /// and a payload anywhere at the tip.
    Spatial,
}

impl ModelPlant {
    /// Its name in configurations.
    pub fn name(self) -> &'static str {
        match self {
            Self::Thesis => "thesis",
            Self::Consistent => "consistent",
            Self::FiniteElement => "finite_element",
            Self::ExactRigidLink1 => "exact_rigid_link1",
            Self::Spatial => "spatial",
        }
    }

    fn assumes_modes(self) -> bool {
        matches!(self, Self::Thesis | Self::Consistent)
    }

    /// Most finite elements, for plants that have them.
    fn most_elements(self) -> Option<usize> {
        match self {
            Self::FiniteElement => Some(finite_element::MAX_ELEMENTS),
            Self::Spatial => Some(spatial::MAX_ELEMENTS),
            _ => None,
        }
    }
}

/// Number of finite elements unless another is asked for.
const DEFAULT_ELEMENTS: usize = 60;

/// Number of modes of models that have any number, unless another is asked for.
const DEFAULT_COUNT: usize = 5;

/// Most modes of the exact problem.
const MAX_EXACT_COUNT: usize = 200;

/// Places along the arm at which mode shapes are given.
const SHAPE_POINTS: usize = 201;

/// What defines a model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSpec {
    /// The two links.
    pub arm: Arm,
    /// The payload.
    pub payload: Payload,
    /// Which model of the bending.
    pub plant: ModelPlant,
    /// Switches of the equations of motion (the thesis plant's).
    pub dynamics: Dynamics,
    /// Assumed modes of link 1 and link 2, 0 for a rigid link; null means (1, 1) for the thesis
    /// plant and (4, 4) for the consistent one.
    pub modes: Option<[usize; 2]>,
    /// Shapes of the assumed modes; null means `b8` for the thesis plant and `mono` for the
    /// consistent one, whose link 1 carries a moment at its end.
    pub shapes: Option<ShapeFamily>,
    /// Number of finite elements; null means 60.
    pub elements: Option<usize>,
    /// How the arm of plant spatial holds its payload.
    pub grapple: Option<Grapple>,
    /// Torsional stiffness G J of link 1 and link 2 of plant spatial, N m^2; null means that of the
    /// thesis' tubes, in the proportion of the bending stiffness to the thesis'.
    pub torsional_stiffness: Option<[f64; 2]>,
}

/// How a payload is held at the tip, in axes of which x points along the arm, y to where a positive slew
/// goes and z along the shoulder's axis.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Grapple {
    /// Centre of mass from the tip, m; null means half the payload's length along x and its offset
    /// along y.
    pub centre: Option<[f64; 3]>,
    /// Moments and products of inertia about the centre of mass before it is rotated, kg m^2: xx, yy, zz,
    /// xy, xz, yz entries of the tensor; null means those of a box as wide as high.
    pub inertia: Option<[f64; 6]>,
    /// Axis times angle by which the payload is rotated about its centre of mass, rad.
    pub rotation: [f64; 3],
}

impl Grapple {
    /// The body that a payload is when it is held so.
    fn body(&self, payload: &PayloadProperties, kind: PayloadInertia) -> Result<Body, ConfigError> {
        let centre = self
            .centre
            .unwrap_or([payload.length / 2.0, payload.offset, 0.0]);
        for (i, value) in centre.into_iter().enumerate() {
            finite(&format!("centre[{i}]"), value)?;
        }
        for (i, value) in self.rotation.into_iter().enumerate() {
            finite(&format!("rotation[{i}]"), value)?;
        }
        let across = payload.inertia_centre;
        let along = match kind {
            PayloadInertia::Full => payload.mass * payload.width * payload.width / 6.0,
            PayloadInertia::Slender => 0.0,
        };
        let [xx, yy, zz, xy, xz, yz] = self
            .inertia
            .unwrap_or([along, across, across, 0.0, 0.0, 0.0]);
        let own = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        if let Some(entries) = self.inertia {
            for (i, value) in entries.into_iter().enumerate() {
                finite(&format!("inertia[{i}]"), value)?;
            }
            let principal = own.symmetric_eigenvalues();
            let largest = principal.amax();
            if principal.min() < -1e-9 * largest {
                return Err(ConfigError::value(
                    "inertia",
                    "must have principal moments that are not negative",
                    format!("{entries:?}"),
                ));
            }
            if payload.mass == 0.0 && largest > 0.0 {
                let requirement = "must be zero where the payload's mass is";
                return Err(ConfigError::value(
                    "inertia",
                    requirement,
                    format!("{entries:?}"),
                ));
            }
        }
        let turn = Rotation3::new(Vector3::from(self.rotation)).into_inner();
        Ok(Body {
            mass: payload.mass,
            centre: centre.into(),
            inertia: turn * own * turn.transpose(),
        })
    }
}

impl ModelSpec {
    fn modes(&self) -> [usize; 2] {
        self.modes.unwrap_or(match self.plant {
            ModelPlant::Consistent => [4, 4],
            _ => [1, 1],
        })
    }

    fn shapes(&self) -> ShapeFamily {
        self.shapes.unwrap_or(match self.plant {
            ModelPlant::Consistent => ShapeFamily::Mono,
            _ => ShapeFamily::B8,
        })
    }

    /// Refuses what the plant has no use for, and numbers out of range.
    fn validate(&self) -> Result<(), ConfigError> {
        let plant = self.plant.name();
        let foreign = |name: &str, value: String| {
            Err(ConfigError::value(
                name,
                format!("has no meaning for plant {plant}"),
                value,
            ))
        };
        if !self.plant.assumes_modes() {
            if let Some(modes) = self.modes {
                return foreign("modes", format!("{modes:?}"));
            }
            if let Some(shapes) = self.shapes {
                return foreign("shapes", format!("{shapes:?}").to_lowercase());
            }
        }
        if let Some(elements) = self.elements {
            let Some(most) = self.plant.most_elements() else {
                return foreign("elements", elements.to_string());
            };
            if !(3..=most).contains(&elements) {
                let range = format!("must be from 3 to {most}");
                return Err(ConfigError::value("elements", range, elements));
            }
        }
        if self.plant != ModelPlant::Spatial {
            if let Some(grapple) = self.grapple {
                return foreign("grapple", format!("{grapple:?}"));
            }
            if let Some(stiffness) = self.torsional_stiffness {
                return foreign("torsional_stiffness", format!("{stiffness:?}"));
            }
        }
        for (i, stiffness) in self.torsional_stiffness.iter().flatten().enumerate() {
            positive(&format!("torsional_stiffness[{i}]"), *stiffness)?;
        }
        let modes = self.modes();
        if modes == [0, 0] || modes.iter().any(|&count| count > MAX_SHAPES) {
            let range = format!("must be two numbers up to {MAX_SHAPES}, not both 0");
            return Err(ConfigError::value("modes", range, format!("{modes:?}")));
        }
        Ok(())
    }
}

/// A plant with its payload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    spec: ModelSpec,
    payload: PayloadProperties,
    /// The payload in three dimensions.
    body: Body,
    constants: Constants<f64>,
}

impl Model {
    /// Makes a model.
    ///
    /// # Errors
    /// Parameters that no arm has.
    pub fn new(spec: ModelSpec) -> Result<Self, ConfigError> {
        spec.validate()?;
        spec.arm.validate().map_err(|e| e.within("arm"))?;
        spec.dynamics.validate().map_err(|e| e.within("dynamics"))?;
        let payload = PayloadProperties::resolve(&spec.payload).map_err(|e| e.within("payload"))?;
        let body = spec
            .grapple
            .unwrap_or_default()
            .body(&payload, spec.payload.inertia)
            .map_err(|e| e.within("grapple"))?;
        Ok(Self {
            body,
            constants: Constants::new(&spec.arm, &payload, &spec.dynamics),
            spec,
            payload,
        })
    }

    /// From JSON text; parts left out have their defaults.
    ///
    /// # Errors
    /// Malformed text, unknown names, values of the wrong type or out of range.
    pub fn from_json(text: &str) -> Result<Self, ConfigError> {
        let document = crate::config::json::object("model", text)?;
        Self::new(crate::config::json::typed(&document.into())?)
    }

    /// The payload with every dimension known.
    pub fn payload(&self) -> &PayloadProperties {
        &self.payload
    }

    /// Refuses what only the thesis' plant has.
    fn check_thesis(&self) -> Result<(), ConfigError> {
        let spec = &self.spec;
        if spec.plant != ModelPlant::Thesis {
            return Err(ConfigError::value(
                "plant",
                "must be thesis for accelerations, energies and momenta",
                spec.plant.name(),
            ));
        }
        if spec.modes() != [1, 1] || spec.shapes() != ShapeFamily::B8 {
            return Err(ConfigError::value(
                "modes",
                "must be [1, 1] of shapes b8 for equations of motion of the thesis plant",
                format!("{:?} of {:?}", spec.modes(), spec.shapes()).to_lowercase(),
            ));
        }
        Ok(())
    }

    fn check_extension(&self, extension: &Extension<f64>) -> Result<(), ConfigError> {
        self.spec
            .arm
            .validate_extension("extension", extension.length)?;
        finite("rate", extension.rate)?;
        finite("accel", extension.accel)
    }

    fn check(&self, extension: &Extension<f64>) -> Result<(), ConfigError> {
        self.check_thesis()?;
        self.check_extension(extension)
    }

    fn raw(&self, extension: &Extension<f64>) -> Matrices<f64> {
        let dynamics = &self.spec.dynamics;
        let c = &self.constants;
        c.matrices(extension, dynamics.axial_load, dynamics.particle_following)
    }

    /// M, C and K about the undeflected arm, in the order theta, alpha, beta of the thesis' plant or
    /// theta, modes of link 1, modes of link 2 of the consistent one. K contains bending, deployment
    /// and what turning at the slew rate (rad/s) adds.
    ///
    /// # Errors
    /// A plant without equations of motion, an extension outside the arm, or values that are not
    /// finite.
    pub fn matrices(
        &self,
        extension: &Extension<f64>,
        slew_rate: f64,
    ) -> Result<[DMatrix<f64>; 3], ConfigError> {
        Ok(self.equations(extension, slew_rate)?.matrices)
    }

    fn equations(
        &self,
        extension: &Extension<f64>,
        slew_rate: f64,
    ) -> Result<Equations, ConfigError> {
        match self.spec.plant {
            ModelPlant::Consistent => {
                self.check_extension(extension)?;
                finite("slew_rate", slew_rate)?;
                self.consistent_equations(extension, slew_rate)
            }
            ModelPlant::Thesis => {
                self.check(extension)?;
                finite("slew_rate", slew_rate)?;
                Ok(linearization::thesis_equations(
                    &self.raw(extension),
                    slew_rate,
                ))
            }
            _ => Err(ConfigError::value(
                "plant",
                "must be thesis or consistent for equations of motion; this one has frequencies \
                 and shapes",
                self.spec.plant.name(),
            )),
        }
    }

    fn consistent_equations(
        &self,
        extension: &Extension<f64>,
        slew_rate: f64,
    ) -> Result<Equations, ConfigError> {
        let spec = &self.spec;
        let modes @ [link1, link2] = spec.modes();
        let most = (CAPACITY - 1) / 2;
        if modes.iter().any(|count| !(1..=most).contains(count)) {
            let requirement =
                format!("must be two numbers from 1 to {most} for equations of motion");
            return Err(ConfigError::value(
                "modes",
                requirement,
                format!("{modes:?}"),
            ));
        }
        let a = extension.length;
        let plant = ConsistentPlant::with_kinematics(
            &spec.arm,
            &self.payload,
            &spec.dynamics,
            (link1, link2),
            (a, a),
            consistent::Kinematics {
                shapes: spec.shapes(),
                slope_turning: true,
            },
        )?;
        linearization::consistent_equations(&plant, extension, slew_rate)
    }

    /// q'' (rad/s^2, m/s^2, m/s^2) at a state under torques.
    ///
    /// # Errors
    /// An extension outside the arm, or values that are not finite.
    pub fn acceleration(
        &self,
        extension: &Extension<f64>,
        q: [f64; 3],
        v: [f64; 3],
        torques: &Torques<f64>,
    ) -> Result<[f64; 3], ConfigError> {
        self.check(extension)?;
        check_state(q, v)?;
        finite("slew_torque", torques.slew)?;
        finite("root_torque", torques.root)?;
        finite("tip_torque", torques.tip)?;
        Ok(Prepared::new(self.raw(extension)).acceleration(&q, &v, torques, true))
    }

    /// Energy at a state, J; the axial potential at the extension's acceleration.
    ///
    /// # Errors
    /// An extension outside the arm, or values that are not finite.
    pub fn energy(
        &self,
        extension: &Extension<f64>,
        q: [f64; 3],
        v: [f64; 3],
    ) -> Result<Energy, ConfigError> {
        self.check(extension)?;
        check_state(q, v)?;
        let spec = &self.spec;
        Ok(energy(
            &spec.arm,
            &self.payload,
            &spec.dynamics,
            extension,
            q,
            v,
        ))
    }

    /// Angular momentum about the shoulder at a state, N m s.
    ///
    /// # Errors
    /// An extension outside the arm, or values that are not finite.
    pub fn angular_momentum(
        &self,
        extension: &Extension<f64>,
        q: [f64; 3],
        v: [f64; 3],
    ) -> Result<f64, ConfigError> {
        self.check(extension)?;
        check_state(q, v)?;
        let spec = &self.spec;
        Ok(angular_momentum(
            &spec.arm,
            &self.payload,
            &spec.dynamics,
            extension,
            q,
            v,
        ))
    }

    /// Elastic angular frequencies of the arm at rest at a fixed length, rising, rad/s. `None`
    /// means all of assumed modes and the first five of other models.
    ///
    /// # Errors
    /// An extension outside the arm, or more frequencies than the model has.
    pub fn natural_frequencies(
        &self,
        extension: f64,
        count: Option<usize>,
    ) -> Result<Vec<f64>, ConfigError> {
        self.check_modes(extension, count)?;
        let spec = &self.spec;
        let mut found = match spec.plant {
            ModelPlant::Thesis | ModelPlant::Consistent => self.assumed(extension).frequencies(),
            ModelPlant::FiniteElement => self.elements(extension).frequencies(),
            ModelPlant::ExactRigidLink1 => {
                let beam = UniformBeam::rigid_link1(&spec.arm, &self.payload, extension);
                exact::frequencies(
                    &beam,
                    exact::Conditions::Correct,
                    count.unwrap_or(DEFAULT_COUNT),
                )
            }
            ModelPlant::Spatial => return Ok(self.spatial_modes(extension, count)?.frequencies),
        };
        found.truncate(self.wanted(found.len(), count)?);
        Ok(found)
    }

    /// Elastic mode shapes of the arm at rest at a fixed length; `count` as for
    /// [`Self::natural_frequencies`].
    ///
    /// # Errors
    /// An extension outside the arm, or more modes than the model has.
    pub fn mode_shapes(
        &self,
        extension: f64,
        count: Option<usize>,
    ) -> Result<ModeShapes, ConfigError> {
        self.check_modes(extension, count)?;
        let spec = &self.spec;
        let mut found = match spec.plant {
            ModelPlant::Thesis | ModelPlant::Consistent => {
                self.assumed(extension).mode_shapes(SHAPE_POINTS)
            }
            ModelPlant::FiniteElement => self.elements(extension).mode_shapes(SHAPE_POINTS),
            ModelPlant::ExactRigidLink1 => {
                let beam = UniformBeam::rigid_link1(&spec.arm, &self.payload, extension);
                exact::mode_shapes(&beam, count.unwrap_or(DEFAULT_COUNT), SHAPE_POINTS)
            }
            ModelPlant::Spatial => {
                return Err(ConfigError::value(
                    "plant",
                    "must have shapes in the plane alone; this one has spatial modes",
                    spec.plant.name(),
                ));
            }
        };
        let wanted = self.wanted(found.frequencies.len(), count)?;
        found.frequencies.truncate(wanted);
        found.displacements.truncate(wanted);
        Ok(found)
    }

    /// Natural vibrations of plant spatial at rest at a fixed length; `count` as for
    /// [`Self::natural_frequencies`].
    ///
    /// # Errors
    /// Another plant, an extension outside the arm, or more modes than the model has.
    pub fn spatial_modes(
        &self,
        extension: f64,
        count: Option<usize>,
    ) -> Result<SpatialModes, ConfigError> {
        let spec = &self.spec;
        if spec.plant != ModelPlant::Spatial {
            let requirement = "must be spatial for modes in three dimensions";
            return Err(ConfigError::value("plant", requirement, spec.plant.name()));
        }
        self.check_modes(extension, count)?;
        let arm = SpatialBeam::arm(&spec.arm, spec.torsional_stiffness, self.body, extension);
        let most = count.unwrap_or(DEFAULT_COUNT);
        let elements = spec.elements.unwrap_or(DEFAULT_ELEMENTS);
        let found = arm.modes(elements, most, SHAPE_POINTS);
        self.wanted(found.frequencies.len(), count)?;
        Ok(found)
    }

    fn check_modes(&self, extension: f64, count: Option<usize>) -> Result<(), ConfigError> {
        self.spec.arm.validate_extension("extension", extension)?;
        if self.spec.plant == ModelPlant::ExactRigidLink1 {
            self.wanted(MAX_EXACT_COUNT, count)?;
        }
        Ok(())
    }

    fn wanted(&self, available: usize, count: Option<usize>) -> Result<usize, ConfigError> {
        if available == 0 {
            let message = "stiffnesses and masses are too far apart to resolve a vibration";
            return Err(ConfigError::form("model", message));
        }
        match count {
            None if self.spec.plant.assumes_modes() => Ok(available),
            None => Ok(DEFAULT_COUNT.min(available)),
            Some(count) if (1..=available).contains(&count) => Ok(count),
            Some(count) => {
                let range = format!("must be from 1 to {available} for this model");
                Err(ConfigError::value("count", range, count))
            }
        }
    }

    fn assumed(&self, extension: f64) -> AssumedArm {
        let spec = &self.spec;
        let kinematics = match spec.plant {
            ModelPlant::Consistent => Kinematics::Turning,
            _ => Kinematics::Translating,
        };
        let (shapes, modes) = (spec.shapes(), spec.modes());
        AssumedArm::new(
            &spec.arm,
            &self.payload,
            extension,
            kinematics,
            shapes,
            modes,
        )
    }

    fn elements(&self, extension: f64) -> FiniteElementBeam {
        let beam = SegmentedBeam::arm(&self.spec.arm, &self.payload, extension);
        FiniteElementBeam::new(beam, self.spec.elements.unwrap_or(DEFAULT_ELEMENTS))
    }

    /// x' = A x + B u, y = C x about the undeflected arm at a length with its rate and acceleration
    /// and a slew rate (rad/s).
    ///
    /// # Errors
    /// A plant without equations of motion, an extension outside the arm, or values that are not
    /// finite.
    pub fn linearize(
        &self,
        extension: &Extension<f64>,
        slew_rate: f64,
    ) -> Result<Linearization, ConfigError> {
        let equations = self.equations(extension, slew_rate)?;
        equations.solved().ok_or_else(|| {
            ConfigError::value(
                "extension",
                "gives a mass matrix that is not positive definite",
                extension.length,
            )
        })
    }
}

fn check_state(q: [f64; 3], v: [f64; 3]) -> Result<(), ConfigError> {
    for (i, value) in q.into_iter().enumerate() {
        finite(&format!("q[{i}]"), value)?;
    }
    for (i, value) in v.into_iter().enumerate() {
        finite(&format!("q_rate[{i}]"), value)?;
    }
    Ok(())
}
