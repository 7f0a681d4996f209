// Cameras from files: trajectories, intrinsics, organised PCD clouds.
//
// Texts have the forms of TUM RGB-D, Open3D and tsdf-fusion; their lengths are metres, and poses lead from
// the camera to the world. An organised cloud's rows and columns imply a camera and depths.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/geometry.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::stream {

inline constexpr double kMmPerMetre = 1000.0;
/// A trajectory of a day at 100 poses a second.
inline constexpr std::uint64_t kMaxPoseFileBytes = std::uint64_t{1} << 30;

struct TimedPose {
  double t_s = 0.0;
  geometry::RigidTransform world_from_camera;
};

struct TimedFile {
  double t_s = 0.0;
  std::string file;
};

// Errors name a line and no file.

/// TUM: "t tx ty tz qx qy qz qw" a line, # begins a comment; sorted by time.
[[nodiscard]] Result<std::vector<TimedPose>> parse_timed_poses(std::string_view text);
/// TUM: "t file" a line; sorted by time.
[[nodiscard]] Result<std::vector<TimedFile>> parse_timed_files(std::string_view text);
/// Open3D: blocks of a line of indices and a 4 x 4 matrix, in the order of the images.
[[nodiscard]] Result<std::vector<geometry::RigidTransform>> parse_pose_log(std::string_view text);
/// tsdf-fusion: one 4 x 4 matrix.
[[nodiscard]] Result<geometry::RigidTransform> parse_pose(std::string_view text);

/// Puts focal lengths and centre into `camera`: a 3 x 3 matrix, or the four numbers fx fy cx cy with up to
/// five of the lens behind them; or Open3D's JSON with width, height and the matrix column by column.
[[nodiscard]] Status parse_intrinsics(std::string_view text, DepthCamera& camera);

/// Poses further apart say nothing of the time between them: ten steps of a tracker of 100 Hz.
inline constexpr double kMaxPoseGapS = 0.1;

/// Pose at a time between two of `poses`, which rise; nothing where the nearest ones leave too wide a gap.
[[nodiscard]] std::optional<geometry::RigidTransform> pose_at(const std::vector<TimedPose>& poses,
                                                              double t_s);

/// Points of one image in the camera's frame, row by row; not finite where nothing was seen.
struct OrganisedPoints {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<Vec3> points_mm;
};

/// Reads a PCD file by the reader of `readers`; null: an Error. The Error names the file.
[[nodiscard]] Result<OrganisedPoints> read_organised_pcd(const std::string& file, const io::Readers* readers);

/// Focal lengths and centre by least squares over x/z and y/z of all points. An Error where the points do not
/// lie on the rays of one pinhole.
[[nodiscard]] Result<DepthCamera> camera_of(const OrganisedPoints& points);

/// Each point's z; an Error where the size is not the camera's.
[[nodiscard]] Status depths_of(const OrganisedPoints& points, const DepthCamera& camera,
                               std::vector<float>& depth_mm);

}  // namespace palpate::stream
