//! Label grids from and to `ndarray`'s arrays.

use ndarray::{Array3, ArrayView3};

use crate::{Frame, LabelGrid, VoxelError};

impl LabelGrid {
    /// From an array `[z][y][x]` of any memory order.
    ///
    /// ```
    /// use ndarray::Array3;
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::j750(), [4, 3, 2])?;
    /// let array = Array3::from_shape_fn((2, 3, 4), |(z, y, x)| (z * 12 + y * 4 + x) as u8);
    /// let grid = LabelGrid::from_array(frame, array.view())?;
    /// assert_eq!(grid.get([3, 0, 1]), 15);
    /// assert_eq!(grid.to_array()?, array);
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] unless the array's shape is the frame's size, z first.
    pub fn from_array(frame: Frame, labels: ArrayView3<'_, u8>) -> Result<Self, VoxelError> {
        let [x, y, z] = frame.size().map(|s| s as usize);
        if labels.dim() != (z, y, x) {
            return Err(VoxelError::invalid(
                "array of labels",
                format!("its shape {:?} is not the frame's {:?}, z first", labels.dim(), (z, y, x)),
            ));
        }
        Ok(Self::from_rows(frame, |at, row| {
            let [x, y, z] = at.map(|v| v as usize);
            for (out, x) in row.iter_mut().zip(x..) {
                *out = labels[[z, y, x]];
            }
        }))
    }

    /// To an array `[z][y][x]`.
    ///
    /// # Errors
    /// [`VoxelError::Unsupported`] when there is not the memory for one byte a voxel.
    pub fn to_array(&self) -> Result<Array3<u8>, VoxelError> {
        let voxels = self.frame().voxels();
        let too_many = || {
            VoxelError::unsupported(
                "array of labels",
                format!("{voxels} bytes are not to be had; crop the grid"),
            )
        };
        let mut labels = Vec::new();
        let count = usize::try_from(voxels).map_err(|_| too_many())?;
        labels.try_reserve_exact(count).map_err(|_| too_many())?;
        labels.resize(count, 0);
        self.to_dense(&mut labels)?;
        let [x, y, z] = self.size().map(|s| s as usize);
        Array3::from_shape_vec((z, y, x), labels)
            .map_err(|error| VoxelError::unsupported("array of labels", error.to_string()))
    }
}

/// [`LabelGrid::from_array`].
impl TryFrom<(Frame, ArrayView3<'_, u8>)> for LabelGrid {
    type Error = VoxelError;

    fn try_from((frame, labels): (Frame, ArrayView3<'_, u8>)) -> Result<Self, VoxelError> {
        Self::from_array(frame, labels)
    }
}

/// [`LabelGrid::to_array`].
impl TryFrom<&LabelGrid> for Array3<u8> {
    type Error = VoxelError;

    fn try_from(grid: &LabelGrid) -> Result<Self, VoxelError> {
        grid.to_array()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pitch;
    use ndarray::{Axis, Slice};

    #[test]
    fn arrays_of_any_order_go_in_and_out() {
        let label = |[x, y, z]: [u32; 3]| (x + 3 * y + 5 * z) as u8 % 7;
        let frame = |size| Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
        let grid = LabelGrid::from_fn(frame([40, 21, 18]), label);
        let array = Array3::try_from(&grid).unwrap();
        assert_eq!(array[[17, 20, 39]], label([39, 20, 17]));
        assert!(LabelGrid::try_from((frame([40, 21, 18]), array.view())).unwrap() == grid);
        // Swapped axes, and every other plane.
        let turned = LabelGrid::from_array(frame([18, 21, 40]), array.t()).unwrap();
        assert_eq!(turned.get([3, 4, 5]), label([5, 4, 3]));
        let half =
            LabelGrid::from_array(frame([40, 21, 9]), array.slice_axis(Axis(0), Slice::from(..).step_by(2)))
                .unwrap();
        assert_eq!(half.get([1, 2, 4]), label([1, 2, 8]));
        assert!(LabelGrid::from_array(frame([18, 21, 40]), array.view()).is_err());
    }
}
