#include "toolkit/stream/stream_statistics.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>

#include "toolkit/render/depth_camera.h"

namespace palpate::stream {
namespace {

/// Every fourth pixel of every fourth row: 19,200 of a VGA image, so that ten seconds take 50 MB.
constexpr std::size_t kSampleStep = 4;
/// Bins of depth: a quarter of a doubling, over which quadratic noise grows by 1.4.
constexpr double kBinsPerDoubling = 4.0;
/// Fewer samples give a deviation worse than 5 %.
constexpr std::size_t kMinNoiseSamples = 200;
/// The window whose plane is compared with its middle. In inverse depth a plane is linear in the pixel, and
/// its value in the middle of a whole window is the mean.
constexpr std::size_t kPlaneHalf = 2, kPlaneSide = 2 * kPlaneHalf + 1, kPlanePixels = kPlaneSide * kPlaneSide;
/// The largest fifth is left out: edges, curvature and what moves. The rest of a normal distribution has
/// 0.6616 of its deviation: 1 - 2 q f(q) / p with p = 0.8, q = 1.2816, f(q) = 0.1755, and the root.
constexpr double kTrimmedShare = 0.8, kTrimmedDeviation = 0.6616;
/// Differences in time so many times those in space are motion: of the scene, or of a camera without poses.
constexpr double kMotionTimes = 3.0;
/// A source that gives only errors, such as a camera without its cable, is given up.
constexpr std::uint64_t kMaxErrorsInRow = 100;

/// Mean and deviation by sums of differences to the first value.
struct Moments {
  double n = 0.0, first = 0.0, sum = 0.0, squares = 0.0;
  void add(double value) noexcept {
    if (n == 0.0) first = value;
    n += 1.0;
    sum += value - first;
    squares += (value - first) * (value - first);
  }
  [[nodiscard]] double mean() const noexcept { return n > 0.0 ? first + sum / n : 0.0; }
  [[nodiscard]] double deviation() const noexcept {
    return n > 1.0 ? std::sqrt(std::max(0.0, (squares - sum * sum / n) / (n - 1.0))) : 0.0;
  }
};

struct NoiseBin {
  Moments depth;
  std::vector<float> temporal, spatial;  ///< sizes of differences, mm
};

/// Deviation of a normal distribution about 0 from its sizes, whose largest may be something else.
double trimmed_deviation(std::vector<float> sizes) {
  if (sizes.size() < kMinNoiseSamples) return 0.0;
  const auto kept = static_cast<std::ptrdiff_t>(kTrimmedShare * static_cast<double>(sizes.size()));
  std::nth_element(sizes.begin(), sizes.begin() + kept, sizes.end());
  double squares = 0.0;
  for (auto it = sizes.begin(); it != sizes.begin() + kept; ++it)
    squares += static_cast<double>(*it) * static_cast<double>(*it);
  return std::sqrt(squares / static_cast<double>(kept)) / kTrimmedDeviation;
}

class StreamMeter {
 public:
  explicit StreamMeter(const DepthCamera& camera)
      : columns_(static_cast<std::size_t>(camera.width)), rows_(static_cast<std::size_t>(camera.height)) {}

  void add(const DepthFrame& frame) {
    ++out_.frames;
    latency_.add(frame.arrived_s - frame.captured_s);
    if (frame.depth_mm.size() != columns_ * rows_) {
      ++out_.other_size;
      return;
    }
    add_depths(frame);
    const bool in_order = !before_ || frame.captured_s > before_->captured_s;
    if (!in_order) {
      ++out_.out_of_order;
      return;
    }
    bool still = false;
    if (before_) {
      steps_.add(frame.captured_s - before_->captured_s);
      if (frame.number > before_->number) out_.lost += frame.number - before_->number - 1;
      const geometry::RigidTransform &a = before_->world_from_camera, &b = frame.world_from_camera;
      still = a.translation_mm == b.translation_mm && a.rotation.coeffs() == b.rotation.coeffs();
      out_.moves = out_.moves || !still;
    }
    sample(frame, still);
    before_ = frame;
  }

  [[nodiscard]] StreamStatistics finish() {
    if (steps_.n > 0.0) out_.rate_hz = 1.0 / steps_.mean();
    out_.rate_jitter_s = steps_.deviation();
    out_.latency_s = latency_.mean();
    out_.latency_jitter_s = latency_.deviation();
    out_.holes = holes_.mean();
    for (auto& [number, sizes] : bins_) {
      NoiseAtDepth row;
      row.depth_mm = sizes.depth.mean();
      row.samples = std::max(sizes.temporal.size(), sizes.spatial.size());
      row.temporal_mm = trimmed_deviation(std::move(sizes.temporal));
      row.spatial_mm = trimmed_deviation(std::move(sizes.spatial));
      if (row.temporal_mm > kMotionTimes * row.spatial_mm) row.temporal_mm = 0.0;
      if (row.temporal_mm > 0.0 || row.spatial_mm > 0.0) out_.noise.push_back(row);
    }
    fit();
    return std::move(out_);
  }

 private:
  void add_depths(const DepthFrame& frame) {
    std::size_t holes = 0;
    for (const float z : frame.depth_mm) {
      if (!render::is_measured(z)) {
        ++holes;
        continue;
      }
      const double mm = static_cast<double>(z);
      out_.nearest_mm = out_.nearest_mm > 0.0 ? std::min(out_.nearest_mm, mm) : mm;
      out_.farthest_mm = std::max(out_.farthest_mm, mm);
    }
    const double share = static_cast<double>(holes) / static_cast<double>(frame.depth_mm.size());
    holes_.add(share);
    out_.most_holes = std::max(out_.most_holes, share);
  }

  void sample(const DepthFrame& frame, bool still) {
    for (std::size_t row = kPlaneHalf; row + kPlaneHalf < rows_; row += kSampleStep)
      for (std::size_t column = kPlaneHalf; column + kPlaneHalf < columns_; column += kSampleStep) {
        const std::size_t i = row * columns_ + column;
        const float z = frame.depth_mm[i];
        if (!render::is_measured(z)) continue;
        NoiseBin& bin =
            bins_[static_cast<int>(std::floor(kBinsPerDoubling * std::log2(static_cast<double>(z))))];
        bin.depth.add(static_cast<double>(z));
        if (still && render::is_measured(before_->depth_mm[i]))
          bin.temporal.push_back(std::abs(z - before_->depth_mm[i]) / std::sqrt(2.0f));
        if (const std::optional<double> off_mm = off_plane(frame, i))
          bin.spatial.push_back(static_cast<float>(*off_mm));
      }
  }
  /// Distance of a depth to the plane of its window; nothing where the window has holes.
  [[nodiscard]] std::optional<double> off_plane(const DepthFrame& frame, std::size_t middle) const {
    double inverse = 0.0;
    for (std::size_t row = 0; row < kPlaneSide; ++row)
      for (std::size_t column = 0; column < kPlaneSide; ++column) {
        const float z = frame.depth_mm[middle + row * columns_ + column - kPlaneHalf * columns_ - kPlaneHalf];
        if (!render::is_measured(z)) return std::nullopt;
        inverse += 1.0 / static_cast<double>(z);
      }
    const double z = static_cast<double>(frame.depth_mm[middle]);
    constexpr double kPixels = kPlanePixels;
    // The middle is one of the plane's own pixels: its residual is smaller by this.
    return std::abs(z * z * (1.0 / z - inverse / kPixels)) / std::sqrt(1.0 - 1.0 / kPixels);
  }

  /// Least squares of a + b z^2 with a and b not below 0, each row by its samples.
  void fit() {
    double n = 0.0, x = 0.0, y = 0.0, xx = 0.0, xy = 0.0;
    for (const NoiseAtDepth& row : out_.noise) {
      const double value = row.temporal_mm > 0.0 ? row.temporal_mm : row.spatial_mm,
                   at = row.depth_mm * row.depth_mm;
      if (!(value > 0.0)) continue;
      const double weight = static_cast<double>(row.samples);
      n += weight;
      x += weight * at;
      y += weight * value;
      xx += weight * at * at;
      xy += weight * at * value;
    }
    if (!(n > 0.0)) return;
    const double determinant = n * xx - x * x;
    // One bin, or rounding: depths without spread tell no constant from a slope.
    constexpr double kLeastSpread = 1e-6;
    const bool spread = determinant > kLeastSpread * n * xx;
    const double slope = spread ? (n * xy - x * y) / determinant : xy / xx;
    const double constant = (y - slope * x) / n;
    if (slope < 0.0) {
      out_.noise_mm = y / n;
    } else if (!spread || constant < 0.0) {
      out_.noise_per_mm = xy / xx;
    } else {
      out_.noise_mm = constant;
      out_.noise_per_mm = slope;
    }
  }

  std::size_t columns_, rows_;
  StreamStatistics out_;
  Moments steps_, latency_, holes_;
  std::map<int, NoiseBin> bins_;
  std::optional<DepthFrame> before_;
};

}  // namespace

Result<StreamStatistics> measure_stream(DepthSource& source, std::uint64_t most_frames, Progress& progress) {
  StreamMeter meter(source.camera());
  DepthFrame frame;
  std::uint64_t read = 0, unreadable = 0, errors_in_row = 0;
  const std::uint64_t in_all = source.frames();
  const double wanted = static_cast<double>(in_all > 0 ? std::min(in_all, most_frames) : most_frames);
  while (read < most_frames) {
    if (progress.cancelled()) return Error{"reading the stream was stopped"};
    const Result<bool> more = source.next(frame);
    if (!more) {
      ++unreadable;
      if (++errors_in_row == kMaxErrorsInRow) return more.error();
      continue;
    }
    if (!*more) break;
    errors_in_row = 0;
    ++read;
    meter.add(frame);
    progress.report("reading the stream", static_cast<double>(read) / wanted);
  }
  if (read == 0) return Error{"the stream has no frame that can be read", "check its files, or its camera"};
  StreamStatistics out = meter.finish();
  out.frames_in_all = in_all;
  out.unreadable = unreadable;
  return out;
}

}  // namespace palpate::stream
