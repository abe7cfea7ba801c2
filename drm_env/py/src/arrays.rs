//! NumPy arrays at the edge: dtype, rank and contiguity are checked on the way in, and each has a
//! type hint for the stub.

use std::convert::Infallible;

use numpy::ndarray::{Dimension, IntoDimension, Ix1, Ix2, Ix3};
use numpy::{
    Element, PyArray, PyArrayMethods, PyReadonlyArray, PyReadwriteArray, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::inspect::PyStaticExpr;
use pyo3::prelude::*;
use pyo3::{type_hint_identifier, type_hint_subscript};

/// Element types that cross the boundary, with their name in the stub.
pub(crate) trait Scalar: Element + Copy {
    /// NumPy's name of the type.
    const NAME: &'static str;
    /// `numpy.typing.NDArray[...]` of it.
    const HINT: PyStaticExpr;
}

macro_rules! scalar {
    ($($t:ty => $name:literal),+ $(,)?) => {$(
        impl Scalar for $t {
            const NAME: &'static str = $name;
            const HINT: PyStaticExpr = type_hint_subscript!(
                type_hint_identifier!("numpy.typing", "NDArray"),
                type_hint_identifier!("numpy", $name)
            );
        }
    )+};
}
scalar!(f32 => "float32", f64 => "float64", u8 => "uint8", bool => "bool_");

fn describe(object: Borrowed<'_, '_, PyAny>) -> String {
    match object.cast::<PyUntypedArray>() {
        Ok(array) => format!("a {} array of shape {:?}", array.dtype(), array.shape()),
        Err(_) => object
            .get_type()
            .name()
            .map_or_else(|_| "an unnamed type".into(), |name| name.to_string()),
    }
}

fn checked<'a, 'py, T: Scalar, D: Dimension>(
    object: Borrowed<'a, 'py, PyAny>,
) -> PyResult<Borrowed<'a, 'py, PyArray<T, D>>> {
    let array = object.cast::<PyArray<T, D>>().map_err(|_| {
        let rank = D::NDIM.map_or_else(String::new, |n| format!("{n}-D "));
        PyTypeError::new_err(format!(
            "expected a {rank}{} array, got {}",
            T::NAME,
            describe(object)
        ))
    })?;
    if array.is_c_contiguous() {
        return Ok(array);
    }
    Err(PyValueError::new_err(format!(
        "expected a C-contiguous array, got strides {:?} (numpy.ascontiguousarray makes one)",
        array.strides()
    )))
}

/// A C-contiguous array that is only read.
pub(crate) struct In<'py, T: Scalar, D: Dimension>(PyReadonlyArray<'py, T, D>);
pub(crate) type In1<'py, T> = In<'py, T, Ix1>;
pub(crate) type In2<'py, T> = In<'py, T, Ix2>;
pub(crate) type In3<'py, T> = In<'py, T, Ix3>;

impl<T: Scalar, D: Dimension> In<'_, T, D> {
    pub(crate) fn slice(&self) -> &[T] {
        self.0
            .as_slice()
            .expect("contiguity was checked on extraction")
    }

    pub(crate) fn shape(&self) -> &[usize] {
        self.0.shape()
    }
}

impl<'a, 'py, T: Scalar + 'a, D: Dimension + 'a> FromPyObject<'a, 'py> for In<'py, T, D> {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = T::HINT;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self(checked::<T, D>(object)?.try_readonly()?))
    }
}

/// A C-contiguous, writeable array that is filled in place.
pub(crate) struct InOut<'py, T: Scalar, D: Dimension>(PyReadwriteArray<'py, T, D>);
pub(crate) type InOut1<'py, T> = InOut<'py, T, Ix1>;
pub(crate) type InOut2<'py, T> = InOut<'py, T, Ix2>;

impl<T: Scalar, D: Dimension> InOut<'_, T, D> {
    pub(crate) fn slice_mut(&mut self) -> &mut [T] {
        self.0
            .as_slice_mut()
            .expect("contiguity was checked on extraction")
    }

    pub(crate) fn shape(&self) -> &[usize] {
        self.0.shape()
    }
}

impl<'a, 'py, T: Scalar + 'a, D: Dimension + 'a> FromPyObject<'a, 'py> for InOut<'py, T, D> {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = T::HINT;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        Ok(Self(checked::<T, D>(object)?.try_readwrite()?))
    }
}

/// A fresh array, filled here and handed to Python.
pub(crate) struct Out<'py, T: Scalar, D: Dimension>(Bound<'py, PyArray<T, D>>);
pub(crate) type Out1<'py, T> = Out<'py, T, Ix1>;
pub(crate) type Out2<'py, T> = Out<'py, T, Ix2>;
pub(crate) type Out3<'py, T> = Out<'py, T, Ix3>;

impl<'py, T: Scalar, D: Dimension> Out<'py, T, D> {
    /// An array of `shape` that holds `values`, row by row.
    pub(crate) fn new<S: IntoDimension<Dim = D>>(py: Python<'py>, shape: S, values: &[T]) -> Self {
        let array = PyArray::<T, D>::zeros(py, shape, false);
        array
            .readwrite()
            .as_slice_mut()
            .expect("a fresh array is contiguous")
            .copy_from_slice(values);
        Self(array)
    }
}

impl<'py, T: Scalar> Out1<'py, T> {
    /// A vector that holds `values`.
    pub(crate) fn vector(py: Python<'py>, values: &[T]) -> Self {
        Self::new(py, values.len(), values)
    }
}

impl<'py> Out2<'py, f64> {
    /// A matrix that takes the memory of its `values`, row by row.
    ///
    /// # Errors
    /// Another number of values than `shape` has.
    pub(crate) fn taken(
        py: Python<'py>,
        shape: (usize, usize),
        values: Vec<f64>,
    ) -> PyResult<Self> {
        let flat = PyArray::from_vec(py, values);
        Ok(Self(flat.reshape([shape.0, shape.1])?))
    }

    /// A matrix of the given rows.
    pub(crate) fn matrix<const N: usize>(py: Python<'py>, rows: &[[f64; N]]) -> Self {
        Self::new(py, (rows.len(), N), rows.as_flattened())
    }
}

impl<'py, T: Scalar, D: Dimension> IntoPyObject<'py> for Out<'py, T, D> {
    type Target = PyArray<T, D>;
    type Output = Bound<'py, Self::Target>;
    type Error = Infallible;
    const OUTPUT_TYPE: PyStaticExpr = T::HINT;

    fn into_pyobject(self, _py: Python<'py>) -> Result<Self::Output, Infallible> {
        Ok(self.0)
    }
}
