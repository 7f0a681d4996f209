#include "toolkit/stream/camera_files.h"

#include <fmt/format.h>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include <palpate/progress.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"

namespace palpate::stream {

// ---- texts

namespace {

/// Rotations in files are printed with four digits or more, and trackers drift in the last.
constexpr double kRotationSlack = 1e-2;
constexpr std::size_t kMatrixNumbers = 16, kIntrinsicNumbers = 9, kPinholeNumbers = 4, kLensNumbers = 5;
/// The columns of a matrix in a file of rows are this far apart.
constexpr std::size_t kPoseRow = 4, kIntrinsicRow = 3;
/// "t tx ty tz qx qy qz qw".
constexpr std::size_t kTimedPoseNumbers = 8;

constexpr const char* kPoseRemedy = "a pose is a 4 x 4 matrix of a rotation, metres and 0 0 0 1";
constexpr const char* kIntrinsicsRemedy =
    "it has a 3 x 3 matrix with the focal lengths and the centre in pixels, or fx fy cx cy";

/// Lines with something on them, comments left out.
class TextLines {
 public:
  explicit TextLines(std::string_view text) : rest_(text) {}
  [[nodiscard]] bool next(std::string_view& line) {
    while (!rest_.empty()) {
      const std::size_t end = std::min(rest_.find('\n'), rest_.size());
      line = rest_.substr(0, end);
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      ++number_;
      std::string_view tokens = line;
      const std::string_view first = io::next_token(tokens);
      if (!first.empty() && first.front() != '#') return true;
    }
    return false;
  }
  [[nodiscard]] Error error(std::string what, const char* remedy) const {
    return {std::move(what), remedy, {}, number_};
  }

 private:
  std::string_view rest_;
  std::int64_t number_ = 0;
};

/// Fills `out` from the line's front. False where a number is missing or not finite.
bool take_numbers(std::string_view& line, std::span<double> out) {
  for (double& number : out) {
    const std::optional<double> value = io::parse_real(io::next_token(line));
    if (!value || !std::isfinite(*value)) return false;
    number = *value;
  }
  return true;
}

/// The same from as many lines as it takes.
bool take_numbers(TextLines& lines, std::span<double> out, std::size_t a_line) {
  std::string_view line;
  for (std::size_t at = 0; at < out.size(); at += a_line)
    if (!lines.next(line) || !take_numbers(line, out.subspan(at, a_line))) return false;
  return true;
}

bool rigid_from(const std::array<double, kMatrixNumbers>& m, geometry::RigidTransform& pose) {
  Mat3 r;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      r(row, column) = m[static_cast<std::size_t>(row) * kPoseRow + static_cast<std::size_t>(column)];
  const bool last = m[12] == 0.0 && m[13] == 0.0 && m[14] == 0.0 && m[15] == 1.0;
  if (!last || !((r * r.transpose() - Mat3::Identity()).norm() < kRotationSlack) || !(r.determinant() > 0.0))
    return false;
  pose.rotation = Eigen::Quaterniond(r).normalized();
  pose.translation_mm = kMmPerMetre * Vec3(m[3], m[7], m[11]);
  return true;
}

Status take_pinhole(double fx, double fy, double cx, double cy, DepthCamera& camera) {
  if (!(fx > 0.0 && fy > 0.0 && std::isfinite(fx + fy + cx + cy)))
    return Error{"the focal lengths are not above 0", kIntrinsicsRemedy};
  camera.fx_px = fx;
  camera.fy_px = fy;
  camera.cx_px = cx;
  camera.cy_px = cy;
  return Done{};
}

Status parse_json_intrinsics(std::string_view text, DepthCamera& camera) {
  const nlohmann::json object = nlohmann::json::parse(text, nullptr, false);
  const auto size = [&object](const char* key, int& into) {
    const auto found = object.find(key);
    // Of a camera; what a file's images have is compared with it.
    constexpr std::int64_t kMost = std::int64_t{1} << 16;
    if (found == object.end() || !found->is_number_integer()) return false;
    const auto value = found->get<std::int64_t>();
    if (value < 1 || value > kMost) return false;
    into = static_cast<int>(value);
    return true;
  };
  std::array<double, kIntrinsicNumbers> m{};
  bool good = object.is_object() && size("width", camera.width) && size("height", camera.height) &&
              object.contains("intrinsic_matrix") && object["intrinsic_matrix"].is_array() &&
              object["intrinsic_matrix"].size() == m.size();
  for (std::size_t i = 0; good && i < m.size(); ++i) {
    const auto& number = object["intrinsic_matrix"][i];
    good = number.is_number();
    if (good) m[i] = number.get<double>();
  }
  if (!good)
    return Error{"the intrinsics are not {\"width\", \"height\", \"intrinsic_matrix\": nine numbers}",
                 kIntrinsicsRemedy};
  return take_pinhole(m[0], m[4], m[6], m[7], camera);
}

}  // namespace

Result<std::vector<TimedPose>> parse_timed_poses(std::string_view text) {
  std::vector<TimedPose> poses;
  TextLines lines(text);
  std::string_view line;
  while (lines.next(line)) {
    std::array<double, kTimedPoseNumbers> n{};
    const bool read = take_numbers(line, n);
    const Eigen::Quaterniond turn(n[7], n[4], n[5], n[6]);
    if (!read || !(std::abs(turn.norm() - 1.0) < kRotationSlack))
      return lines.error("the line is no pose", "a line is: t tx ty tz qx qy qz qw, in s and m");
    poses.push_back({n[0], {turn.normalized(), kMmPerMetre * Vec3(n[1], n[2], n[3])}});
  }
  std::stable_sort(poses.begin(), poses.end(),
                   [](const TimedPose& a, const TimedPose& b) { return a.t_s < b.t_s; });
  return poses;
}

Result<std::vector<TimedFile>> parse_timed_files(std::string_view text) {
  std::vector<TimedFile> files;
  TextLines lines(text);
  std::string_view line;
  while (lines.next(line)) {
    double t_s = 0.0;
    const bool timed = take_numbers(line, std::span(&t_s, 1));
    const std::string_view file = io::next_token(line);
    if (!timed || file.empty()) return lines.error("the line names no image", "a line is: t file, in s");
    files.push_back({t_s, std::string(file)});
  }
  std::stable_sort(files.begin(), files.end(),
                   [](const TimedFile& a, const TimedFile& b) { return a.t_s < b.t_s; });
  return files;
}

Result<std::vector<geometry::RigidTransform>> parse_pose_log(std::string_view text) {
  std::vector<geometry::RigidTransform> poses;
  TextLines lines(text);
  std::string_view indices;
  while (lines.next(indices)) {
    std::array<double, kMatrixNumbers> m{};
    geometry::RigidTransform pose;
    if (!take_numbers(lines, m, kPoseRow) || !rigid_from(m, pose))
      return lines.error("the block is no pose", kPoseRemedy);
    poses.push_back(pose);
  }
  return poses;
}

Result<geometry::RigidTransform> parse_pose(std::string_view text) {
  TextLines lines(text);
  std::array<double, kMatrixNumbers> m{};
  geometry::RigidTransform pose;
  if (!take_numbers(lines, m, kPoseRow) || !rigid_from(m, pose))
    return lines.error("the text is no pose", kPoseRemedy);
  return pose;
}

Status parse_intrinsics(std::string_view text, DepthCamera& camera) {
  if (text.find('{') != std::string_view::npos) return parse_json_intrinsics(text, camera);
  TextLines lines(text);
  std::string_view line;
  std::array<double, kPinholeNumbers + kLensNumbers> row{};
  if (!lines.next(line) || !take_numbers(line, std::span(row).first(kIntrinsicRow)))
    return lines.error("the line has no intrinsics", kIntrinsicsRemedy);
  if (line.find_first_not_of(" \t\r") != std::string_view::npos) {  // fx fy cx cy k1 k2 p1 p2 k3
    std::size_t count = kIntrinsicRow;
    while (count < row.size() && take_numbers(line, std::span(row).subspan(count, 1))) ++count;
    if (count < kPinholeNumbers) return lines.error("the line has no intrinsics", kIntrinsicsRemedy);
    std::copy_n(row.begin() + kPinholeNumbers, kLensNumbers, camera.distortion.begin());
    return take_pinhole(row[0], row[1], row[2], row[3], camera);
  }
  std::array<double, kIntrinsicNumbers> m{};
  std::copy_n(row.begin(), kIntrinsicRow, m.begin());
  if (!take_numbers(lines, std::span(m).subspan(kIntrinsicRow), kIntrinsicRow))
    return lines.error("the matrix ends too early", kIntrinsicsRemedy);
  return take_pinhole(m[0], m[4], m[2], m[5], camera);
}

std::optional<geometry::RigidTransform> pose_at(const std::vector<TimedPose>& poses, double t_s) {
  const auto after = std::lower_bound(poses.begin(), poses.end(), t_s,
                                      [](const TimedPose& pose, double t) { return pose.t_s < t; });
  if (after != poses.end() && after->t_s == t_s) return after->world_from_camera;
  if (after == poses.begin() || after == poses.end()) {
    if (poses.empty()) return std::nullopt;
    const TimedPose& nearest = after == poses.end() ? poses.back() : *after;
    // Half a gap: what a pose stands for on either side.
    return std::abs(nearest.t_s - t_s) <= 0.5 * kMaxPoseGapS ? std::optional(nearest.world_from_camera)
                                                             : std::nullopt;
  }
  const TimedPose &a = *std::prev(after), &b = *after;
  if (b.t_s - a.t_s > kMaxPoseGapS) return std::nullopt;
  const double share = (t_s - a.t_s) / (b.t_s - a.t_s);
  geometry::RigidTransform pose;
  pose.rotation = a.world_from_camera.rotation.slerp(share, b.world_from_camera.rotation).normalized();
  pose.translation_mm = a.world_from_camera.translation_mm +
                        share * (b.world_from_camera.translation_mm - a.world_from_camera.translation_mm);
  return pose;
}

// ---- organised PCD files

namespace {

/// Off by more than this, as root mean square, the points are another camera's or were moved: PCL makes its
/// clouds from the pinhole itself, so that only rounding is left.
constexpr double kMaxRayErrorPx = 1.0;
constexpr const char* kOrganisedRemedy =
    "a sequence needs organised clouds in the camera's frame, as PCL's grabbers write them; or give the "
    "camera";

/// A straight line through pairs, by sums.
struct LineFit {
  double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0, yy = 0.0;
  void add(double at, double value) noexcept {
    n += 1.0;
    x += at;
    y += value;
    xx += at * at;
    xy += at * value;
    yy += value * value;
  }
  [[nodiscard]] double slope() const noexcept { return (n * xy - x * y) / (n * xx - x * x); }
  [[nodiscard]] double offset() const noexcept { return (y - slope() * x) / n; }
  [[nodiscard]] double rms() const noexcept {
    const double a = slope(), b = offset();
    return std::sqrt(std::max(0.0, (yy - a * xy - b * y) / n));
  }
};

}  // namespace

Result<OrganisedPoints> read_organised_pcd(const std::string& file, const io::Readers* readers) {
  const io::Reader* const reader = readers != nullptr ? readers->find(pcd::kPcdExtension) : nullptr;
  if (reader == nullptr)
    return Error{"PCD files cannot be read by this program", "build Palpate with PALPATE_WITH_PCD", file};
  PALPATE_ASSIGN(const std::unique_ptr<io::ByteSource> bytes, io::open_file(file));
  const io::ReadOptions options;
  Result<io::DecodedFile> decoded = (*reader)(io::ReaderInput{*bytes, file, options, no_progress()});
  if (!decoded) return std::move(decoded).error().in_file(file);
  if (!decoded->raster) return Error{"the cloud has no rows: its HEIGHT is 1", kOrganisedRemedy, file};
  OrganisedPoints points{decoded->raster->columns, decoded->raster->rows, std::move(decoded->points)};
  const double mm = io::mm_per(decoded->conventional_unit.value_or(io::Unit::kMetre));
  for (Vec3& p : points.points_mm) p *= mm;
  return points;
}

Result<DepthCamera> camera_of(const OrganisedPoints& points) {
  LineFit across, down;
  for (std::size_t i = 0; i < points.points_mm.size(); ++i) {
    const Vec3& p = points.points_mm[i];
    if (!is_finite(p) || !(p.z() > 0.0)) continue;
    across.add(p.x() / p.z(), static_cast<double>(i % points.width));
    down.add(p.y() / p.z(), static_cast<double>(i / points.width));
  }
  DepthCamera camera;
  camera.width = static_cast<int>(points.width);
  camera.height = static_cast<int>(points.height);
  camera.fx_px = across.slope();
  camera.fy_px = down.slope();
  camera.cx_px = across.offset();
  camera.cy_px = down.offset();
  const double error_px = std::max(across.rms(), down.rms());
  if (!(camera.fx_px > 0.0 && camera.fy_px > 0.0 && error_px < kMaxRayErrorPx))
    return Error{fmt::format("the points do not lie on the rays of one camera: {:.3g} pixels off", error_px),
                 kOrganisedRemedy};
  return camera;
}

Status depths_of(const OrganisedPoints& points, const DepthCamera& camera, std::vector<float>& depth_mm) {
  if (points.points_mm.size() != camera.pixels() || points.width != static_cast<std::uint32_t>(camera.width))
    return Error{fmt::format("the cloud has {} x {} points, the camera {} x {} pixels", points.width,
                             points.height, camera.width, camera.height),
                 "all clouds of a folder come from one camera: move the others"};
  depth_mm.resize(points.points_mm.size());
  for (std::size_t i = 0; i < depth_mm.size(); ++i) {
    const Vec3& p = points.points_mm[i];
    depth_mm[i] = is_finite(p) && p.z() > 0.0 ? static_cast<float>(p.z()) : 0.0f;
  }
  return Done{};
}

}  // namespace palpate::stream
