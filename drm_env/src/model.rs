//! The plant at one length for people who want its equations: matrices, accelerations, energy,
//! modes and the linear state-space form. The same code that steps.

use nalgebra::{Matrix3, SMatrix};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::arm::{Arm, Payload, PayloadProperties, finite};
use crate::error::ConfigError;
use crate::modal::{ElasticModes, elastic_modes};
use crate::plant::energy::{Energy, angular_momentum, energy};
use crate::plant::thesis::{Constants, Matrices, Prepared};
use crate::plant::{Dynamics, Extension, PlantModel, Torques};

/// What defines a model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ModelSpec {
    /// The two links.
    pub arm: Arm,
    /// The payload.
    pub payload: Payload,
    /// Equations of motion.
    pub plant: PlantModel,
    /// Switches of the equations of motion.
    pub dynamics: Dynamics,
}

/// A plant with its payload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    spec: ModelSpec,
    payload: PayloadProperties,
    constants: Constants<f64>,
}

impl Model {
    /// Makes a model.
    ///
    /// # Errors
    /// Parameters that no arm has.
    pub fn new(spec: ModelSpec) -> Result<Self, ConfigError> {
        spec.arm.validate().map_err(|e| e.within("arm"))?;
        spec.dynamics.validate().map_err(|e| e.within("dynamics"))?;
        let payload = PayloadProperties::resolve(&spec.payload).map_err(|e| e.within("payload"))?;
        Ok(Self {
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
        let document = crate::config::object("model", text)?;
        Self::new(crate::config::typed(document.into())?)
    }

    /// The payload with every dimension known.
    pub fn payload(&self) -> &PayloadProperties {
        &self.payload
    }

    fn check(&self, extension: &Extension<f64>) -> Result<(), ConfigError> {
        self.spec
            .arm
            .validate_extension("extension", extension.length)?;
        finite("rate", extension.rate)?;
        finite("accel", extension.accel)
    }

    fn raw(&self, extension: &Extension<f64>) -> Matrices<f64> {
        let dynamics = &self.spec.dynamics;
        let c = &self.constants;
        match (dynamics.axial_load, dynamics.particle_following) {
            (true, false) => c.matrices::<true, false>(extension),
            (false, false) => c.matrices::<false, false>(extension),
            (true, true) => c.matrices::<true, true>(extension),
            (false, true) => c.matrices::<false, true>(extension),
        }
    }

    /// M, C and K in the order (theta, alpha, beta). K contains bending, deployment and the axial
    /// load at the slew rate (rad/s).
    ///
    /// # Errors
    /// An extension outside the arm, or values that are not finite.
    pub fn matrices(
        &self,
        extension: &Extension<f64>,
        slew_rate: f64,
    ) -> Result<[Matrix3<f64>; 3], ConfigError> {
        self.check(extension)?;
        finite("slew_rate", slew_rate)?;
        let m = self.raw(extension);
        let dense = |rows: [[f64; 3]; 3]| Matrix3::from_fn(|i, j| rows[i][j]);
        let mut stiffness = dense(m.stiffness);
        let square = slew_rate * slew_rate;
        stiffness[(1, 1)] += m.axial.a0 + m.axial.a2 * square;
        stiffness[(2, 2)] += m.axial.b0 + m.axial.b2 * square;
        Ok([dense(m.mass), dense(m.velocity), stiffness])
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
        Ok(Prepared::new(self.raw(extension)).acceleration(&q, &v, torques))
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

    /// Elastic modes of the arm at rest at a fixed length.
    ///
    /// # Errors
    /// An extension outside the arm.
    pub fn modes(&self, extension: f64) -> Result<ElasticModes, ConfigError> {
        self.spec.arm.validate_extension("extension", extension)?;
        Ok(elastic_modes(&self.spec.arm, &self.payload, extension))
    }

    /// A and B of x' = A x + B u about the undeflected arm at a length with its rate and
    /// acceleration and a slew rate; x = (theta, alpha, beta and their rates), u = (slew, root, tip
    /// torque).
    ///
    /// # Errors
    /// An extension outside the arm, or values that are not finite.
    pub fn linearize(
        &self,
        extension: &Extension<f64>,
        slew_rate: f64,
    ) -> Result<(SMatrix<f64, 6, 6>, SMatrix<f64, 6, 3>), ConfigError> {
        let [mass, velocity, stiffness] = self.matrices(extension, slew_rate)?;
        let m = self.raw(extension);
        let inverse = mass.try_inverse().ok_or_else(|| {
            ConfigError::value(
                "extension",
                "gives a singular mass matrix",
                extension.length,
            )
        })?;
        let mut a = SMatrix::<f64, 6, 6>::zeros();
        a.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&Matrix3::identity());
        a.fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&(-inverse * stiffness));
        a.fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(-inverse * velocity));
        let input = Matrix3::new(
            1.0,
            1.0,
            m.tip_on_slew,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            m.tip_slope,
        );
        let mut b = SMatrix::<f64, 6, 3>::zeros();
        b.fixed_view_mut::<3, 3>(3, 0).copy_from(&(inverse * input));
        Ok((a, b))
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
