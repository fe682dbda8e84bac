// Cameras in the files of other programs: mrcal's .cameramodel and OpenCV's FileStorage YAML, written and read.
//
// Lens: the model of calib/model/camera.h is mrcal's LENSMODEL_PINHOLE (no distortion), LENSMODEL_OPENCV4 (k3 = 0) or
// LENSMODEL_OPENCV5 and OpenCV's five coefficients (k1, k2, p1, p2, k3), and pixel (0, 0) is the centre of the top-left
// pixel in all three: nothing is converted, every number is written with the digits that read back to the same double.
// Pose: cam_from_reference. mrcal: `extrinsics`, the rotation vector (rad) and the translation in *metres*, as its tools
// take it; OpenCV: R and T, T in mm.
// A projector becomes a camera whose pixels are the stripes of its finest Gray bit (1 px of a display, a stripe of a
// grating), with w = stripe_width():
//   px = u / w - 1/2,   f_px = f / w,   c_px = u0 / w - 1/2                                                      (1)
// An axis that is not coded gets the focal length of the other and its principal point in the middle of as many stripes:
// nothing measured, and the file says so. [mrcal] [OpenCV]
// Errors: InputError where a file cannot be used: not of one of the two kinds, another lens model, numbers missing or not
// finite.
#pragma once

#include "calib/model/projector.h"
#include "core/rigid.h"

#include <filesystem>
#include <string>

namespace fringecal::calib {

struct PlacedCamera {
  model::Camera camera;
  Rigid3 cam_from_reference;
};

enum class LensFormat { mrcal, opencv };
/// ".cameramodel" or ".yml".
const char* ending_of(LensFormat format);

/// `comment`: lines for the head of the file (where the numbers come from).
std::string lens_file(const PlacedCamera& placed, LensFormat format, const std::string& comment);
/// The kind is told by the content.
PlacedCamera read_lens_file(const std::filesystem::path& file);

/// Eq. 1 and back; the codes are those of `like`.
model::Camera camera_of(const model::Projector& projector);
model::Projector projector_of(const model::Camera& camera, const model::Projector& like);

}  // namespace fringecal::calib
