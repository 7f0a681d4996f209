#include "toolkit/depth_surface/depth_fusion.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate::depth_surface {

using namespace render;

namespace {

/// Pixels that a window's result depends on beyond its border: comparing, linking and smoothing together.
constexpr int kSupport = DepthSheets::kBorder;
/// The common motion is taken over 7 x 7 pixels, which divide the noise by 7.
constexpr int kMotionRadius = 3;
/// More of them without a jump than this: what jumps there is alone.
constexpr float kMostOfMotion = 0.5F * (2 * kMotionRadius + 1) * (2 * kMotionRadius + 1);
/// A mean beyond this many of its standard deviations is a motion; from there on, the more of it counts.
constexpr float kMotionSigmas = 3.0F;
/// Changes that spread by no more than this times their noise's variance are one motion: the spread of 49
/// varies by a fifth. Else each pixel follows where that explains it better.
constexpr float kTogether = 2.0F;
constexpr float kGateSigmas = static_cast<float>(kNoiseSigmas);
/// Share of a motion that a pixel's own may differ by: what turns, tilts and speeds up.
constexpr float kMotionError = 0.125F;
/// The motion around explains a pixel's change if less than this share is left; else something else came.
constexpr float kFollowedShare = 0.5F;
/// Depths are floats: their rounding is the least noise.
constexpr float kRounding = 0x1p-22F;
/// A filled pixel's variance over a measured one's: the mean of two places at distance 1 of an unknown one.
constexpr float kFilledVariance = 4.0F;
/// Neighbours that differ by less than a slope of 60 degrees need no witness that the surface is steep.
constexpr float kPlainSlope = 1.73F;
/// The steps of a curved surface grow at most so from pixel to pixel up to its outline: sqrt(2) + 1 at the
/// last.
constexpr float kSteepening = 2.0F;
/// Fewer neighbours of one sheet make no surface: what an edge's mixed light shows between two.
constexpr int kLeastLinks = 2;
/// Surfaces of this radius in pixels are kept: smoothing bends no more than it takes from the noise.
constexpr double kSmoothedRadius = 32.0;
constexpr int kLargestRadius = 3;
/// Noise left over by the filter in time: sqrt(g / (2 - g)) of the least gain.
const double kLeftOver = std::sqrt(kLeastGain / (2.0 - kLeastGain));
/// Every so many pixels a sample of the noise; a prime, so that no pattern of the raster repeats.
constexpr std::size_t kSampleStep = 61;
/// Share of the image away from edges; the mean of so many least absolute values of a normal; and a second
/// difference's standard deviation over a value's.
constexpr double kBelowEdges = 0.9;
constexpr float kMeanBelow = 0.6573F, kSecondDifference = 2.4495F;
/// Weight of an image's noise: over eight, its own scatter is nothing.
constexpr float kNoiseGain = 0.125F;
/// Pixels that the camera's motion may move an image between two frames, for a window: 3 degrees.
constexpr int kWarpReach = 32;

PixelWindow grown(const PixelWindow& w, int by, const stream::DepthCamera& camera) noexcept {
  return {std::max(0, w.first_column - by), std::max(0, w.first_row - by),
          std::min(camera.width, w.last_column + by), std::min(camera.height, w.last_row + by)};
}

}  // namespace

DepthFusion::DepthFusion(const stream::DepthCamera& camera)
    : camera_(camera), grid_(camera), steep_(static_cast<float>(kSteepestSlope / camera.fx_px)) {
  const std::size_t n = grid_.front.size();
  for (State* state : {&before_, &now_, &warped_}) {
    for (Raster* raster : state->rasters()) raster->assign(n, 0.0F);
    state->right.assign(n, 0);
    state->below.assign(n, 0);
  }
  for (Raster* raster : {&measured_, &half_, &rate_, &row_change_, &row_square_, &row_counted_})
    raster->assign(n, 0.0F);
  for (Raster* row : {&change_, &counted_}) row->assign(static_cast<std::size_t>(grid_.stride), 0.0F);
  samples_.reserve(camera.pixels() / kSampleStep + 1);
  if (camera.distortion == std::array<double, 5>{}) return;
  const PixelRays rays(camera);
  lens_u_.assign(n, 0.0F);
  lens_v_.assign(n, 0.0F);
  for (int v = 0; v < camera.height; ++v)
    for (int u = 0; u < camera.width; ++u) {
      const PixelPlace at =
          rays.project(Vec3((u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, 1.0));
      lens_u_[grid_.index(u, v)] = static_cast<float>(at.column);
      lens_v_[grid_.index(u, v)] = static_cast<float>(at.row);
    }
}

std::size_t DepthFusion::bytes() const noexcept {
  constexpr std::size_t kRasters = 3 * 6 + 6;
  return before_.w.size() * (kRasters * sizeof(float) + 3 * 2) + grid_.bytes() +
         (lens_u_.size() + lens_v_.size()) * sizeof(float);
}

void DepthFusion::forget() noexcept {
  any_ = false;
  noise_far_ = 0.0F;
  for (Raster* raster : before_.rasters()) std::fill(raster->begin(), raster->end(), 0.0F);
}

void DepthFusion::begin(const stream::DepthFrame& image, DepthSheets& sheets) noexcept {
  const geometry::RigidTransform last = pose_;
  pose_ = image.world_from_camera;
  const geometry::RigidTransform camera_from_world = pose_.inverse();
  sheets.camera_from_local = camera_from_world.rotation.toRotationMatrix();
  sheets.offset_mm = camera_from_world.translation_mm;
  moved_ = any_ &&
           (last.translation_mm != pose_.translation_mm || last.rotation.coeffs() != pose_.rotation.coeffs());
  turn_ = sheets.camera_from_local * last.rotation.toRotationMatrix();
  shift_mm_ = camera_from_world * last.translation_mm;
  dt_s_ = static_cast<float>(any_ ? image.captured_s - captured_s_ : camera_.period_s);
  captured_s_ = image.captured_s;
  any_ = true;
  prior_ = moved_ ? &warped_ : &before_;
  estimate_noise(image);
  sheets.noise = static_cast<double>(noise_far_) * kLeftOver;
  ++sheets.image;
}

/// The camera's word on its noise; without one, second differences along rows, which are 0 on planes. The
/// greatest tenth, at edges, is left out; a median would be 0 where depths are rounded.
void DepthFusion::estimate_noise(const stream::DepthFrame& image) noexcept {
  const bool known = camera_.noise_mm > 0.0 || camera_.noise_per_mm > 0.0;
  const std::vector<float>& z = image.depth_mm;
  // The mean of a share of the samples, the least ones.
  const auto mean_of_least = [this](double share) noexcept {
    const auto end =
        samples_.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(samples_.size()));
    if (end == samples_.begin()) return 0.0F;
    std::nth_element(samples_.begin(), end - 1, samples_.end());
    double sum = 0.0;
    for (auto at = samples_.begin(); at != end; ++at) sum += static_cast<double>(*at);
    return static_cast<float>(sum / static_cast<double>(end - samples_.begin()));
  };
  samples_.clear();
  for (std::size_t i = 1; i + 1 < z.size(); i += kSampleStep)
    if (is_measured(z[i])) samples_.push_back(1.0F / z[i]);
  const float w = mean_of_least(1.0);
  samples_.clear();
  for (std::size_t i = 1; i + 1 < z.size(); i += kSampleStep)
    if (is_measured(z[i - 1]) && is_measured(z[i]) && is_measured(z[i + 1]))
      samples_.push_back(std::abs(1.0F / z[i - 1] - 2.0F / z[i] + 1.0F / z[i + 1]));
  noise_near_ = static_cast<float>(camera_.noise_mm);
  const float found =
      std::max(kRounding * w, known ? static_cast<float>(camera_.noise_per_mm)
                                    : mean_of_least(kBelowEdges) / (kMeanBelow * kSecondDifference));
  noise_far_ = noise_far_ > 0.0F ? noise_far_ + kNoiseGain * (found - noise_far_) : found;
  choose_radius(static_cast<double>(w));
}

/// The radius whose noise and bend, in pixels of depth, are least together.
void DepthFusion::choose_radius(double w) noexcept {
  const double sigma_px =
      w > 0.0 ? std::sqrt(static_cast<double>(variance_of(static_cast<float>(w)))) * camera_.fx_px / w : 0.0;
  double least = 0.0;
  for (int r = 0; r <= kLargestRadius; ++r) {
    // The mean over (2 r + 1)^2 pixels of (x^2 + y^2) / 2R is r (r + 1) / 3R.
    const double bend = r * (r + 1) / (3.0 * kSmoothedRadius), left = sigma_px * kLeftOver / (2 * r + 1);
    const double sum = bend * bend + left * left;
    if (r > 0 && !(sum < least)) continue;
    least = sum;
    radius_ = r;
  }
}

void DepthFusion::update(const stream::DepthFrame& image, const PixelWindow& window,
                         DepthSheets& sheets) noexcept {
  const PixelWindow around = grown(window, kSupport, camera_);
  invert(image, around);
  if (moved_) warp(around);
  compare(around);
  fuse(around);
  fill(around);
  link(around);
  smooth(around);
  write(window, sheets);
}

float DepthFusion::inverse_at(const stream::DepthFrame& image, int u, int v) const noexcept {
  if (u < 0 || v < 0 || u >= camera_.width || v >= camera_.height) return 0.0F;
  const float z = image.depth_mm[static_cast<std::size_t>(v) * static_cast<std::size_t>(camera_.width) +
                                 static_cast<std::size_t>(u)];
  return is_measured(z) ? 1.0F / z : 0.0F;
}

/// Inverse depths of the raster, the lens undone: linear between four pixels of one sheet, else the nearest.
void DepthFusion::invert(const stream::DepthFrame& image, const PixelWindow& window) noexcept {
  for (int v = window.first_row; v < window.last_row; ++v)
    for (int u = window.first_column; u < window.last_column; ++u) {
      const std::size_t i = grid_.index(u, v);
      if (lens_u_.empty()) {
        measured_[i] = inverse_at(image, u, v);
        continue;
      }
      const float left = std::floor(lens_u_[i]), top = std::floor(lens_v_[i]);
      const float s = lens_u_[i] - left, t = lens_v_[i] - top;
      const int x = static_cast<int>(left), y = static_cast<int>(top);
      const float a = inverse_at(image, x, y), b = inverse_at(image, x + 1, y),
                  c = inverse_at(image, x, y + 1), d = inverse_at(image, x + 1, y + 1);
      const float low = std::min({a, b, c, d}), high = std::max({a, b, c, d});
      const auto most = static_cast<float>(grid_.reach(static_cast<double>(high), 1.0));
      measured_[i] = low > 0.0F && high - low <= most ? (a + s * (b - a)) * (1.0F - t) + t * (c + s * (d - c))
                                                      : inverse_at(image, x + (s > 0.5F), y + (t > 0.5F));
    }
}

/// Moves the state into the raster of the camera's new place; the nearest comes to the front.
void DepthFusion::warp(const PixelWindow& window) noexcept {
  for (Raster* raster : warped_.rasters())
    for (int v = window.first_row; v < window.last_row; ++v) {
      const auto row = raster->begin() + static_cast<std::ptrdiff_t>(grid_.index(window.first_column, v));
      std::fill(row, row + window.columns(), 0.0F);
    }
  const PixelWindow from = grown(window, kWarpReach, camera_);
  for (int v = from.first_row; v < from.last_row; ++v)
    for (int u = from.first_column; u < from.last_column; ++u) {
      const std::size_t i = grid_.index(u, v);
      const Vec3 ray((u - camera_.cx_px) / camera_.fx_px, (v - camera_.cy_px) / camera_.fy_px, 1.0);
      for (const Raster* layer : {&before_.w, &before_.hidden}) {
        const float w = (*layer)[i];
        if (!(w > 0.0F)) continue;
        const bool front = layer == &before_.w;
        const Vec3 q = turn_ * ray + static_cast<double>(w) * shift_mm_;  // times the depth
        const DepthPlace at = grid_.place(q);
        if (at.pixel == 0) continue;
        const int x = static_cast<int>(std::floor(at.u + 0.5)), y = static_cast<int>(std::floor(at.v + 0.5));
        if (x < window.first_column || y < window.first_row || x >= window.last_column ||
            y >= window.last_row)
          continue;
        // A pixel keeps the value of its middle: the slope along its sheet takes it there.
        const auto slope = [&](std::size_t lower, std::size_t upper, bool has_lower, bool has_upper) {
          const float low = has_lower ? w - before_.w[lower] : before_.w[upper] - w;
          const float high = has_upper ? before_.w[upper] - w : low;
          return front && (has_lower || has_upper) ? 0.5F * (low + high) : 0.0F;
        };
        const auto stride = static_cast<std::size_t>(grid_.stride);
        const float gu = slope(i - 1, i + 1, before_.right[i - 1] != 0, before_.right[i] != 0),
                    gv = slope(i - stride, i + stride, before_.below[i - stride] != 0, before_.below[i] != 0);
        const float turned = w / static_cast<float>(q.z());
        const float middle = -(gu * static_cast<float>(at.right) + gv * static_cast<float>(at.below));
        const float shown = front ? before_.shown[i] / static_cast<float>(q.z()) + middle : 0.0F;
        if (front)
          splat(i, at.pixel, turned + middle, shown);
        else if (turned > warped_.hidden[at.pixel]) {
          warped_.hidden[at.pixel] = turned;
          warped_.hidden_age_s[at.pixel] = before_.hidden_age_s[i];
        }
      }
    }
}

void DepthFusion::splat(std::size_t from, std::size_t to, float w, float shown) noexcept {
  State& out = warped_;
  const float there = out.w[to];
  const auto one_sheet = static_cast<float>(grid_.reach(static_cast<double>(w), 1.0));
  if (there > 0.0F && std::abs(there - w) > one_sheet) {
    const bool nearer = w > there;
    out.hidden[to] = std::max(out.hidden[to], nearer ? out.shown[to] : shown);
    out.hidden_age_s[to] = nearer ? out.age_s[to] : before_.age_s[from];
    if (!nearer) return;
  }
  out.w[to] = w;
  out.variance[to] = before_.variance[from];
  out.age_s[to] = before_.age_s[from];
  out.shown[to] = shown;
}

/// The change of each pixel since the last image, summed over each row's neighbours.
void DepthFusion::compare(const PixelWindow& window) noexcept {
  const float fastest = static_cast<float>(kFastestMmPerS) * dt_s_;
  for (int v = window.first_row; v < window.last_row; ++v) {
    const std::size_t first = grid_.index(window.first_column, v);
    const auto columns = static_cast<std::size_t>(window.columns());
    const float *const m = measured_.data() + first, *const w = prior_->w.data() + first;
    float *const d = change_.data() + DepthSheets::kBorder, *const n = counted_.data() + DepthSheets::kBorder;
    std::fill(change_.begin(), change_.end(), 0.0F);
    std::fill(counted_.begin(), counted_.end(), 0.0F);
    for (std::size_t k = 0; k < columns; ++k) {
      const float off = m[k] - w[k];
      const bool same = m[k] > 0.0F && w[k] > 0.0F && std::abs(off) <= fastest * w[k] * w[k];
      d[k] = same ? off : 0.0F;
      n[k] = same ? 1.0F : 0.0F;
    }
    float *const sum = row_change_.data() + first, *const square = row_square_.data() + first,
                 *const count = row_counted_.data() + first;
    for (std::ptrdiff_t k = 0; k < window.columns(); ++k) {
      float s = 0.0F, q = 0.0F, c = 0.0F;
      for (std::ptrdiff_t step = -kMotionRadius; step <= kMotionRadius; ++step) {
        s += d[k + step];
        q += d[k + step] * d[k + step];
        c += n[k + step];
      }
      sum[k] = s;
      square[k] = q;
      count[k] = c;
    }
  }
}

void DepthFusion::fuse(const PixelWindow& window) noexcept {
  for (int v = window.first_row; v < window.last_row; ++v)
    for (std::size_t i = grid_.index(window.first_column, v),
                     end = i + static_cast<std::size_t>(window.columns());
         i < end; ++i) {
      float sum = 0.0F, square = 0.0F, n = 0.0F;
      for (std::ptrdiff_t step = -kMotionRadius; step <= kMotionRadius; ++step) {
        const std::size_t j = i + static_cast<std::size_t>(step * grid_.stride);
        sum += row_change_[j];
        square += row_square_[j];
        n += row_counted_[j];
      }
      float shift = 0.0F, rate = 0.0F;
      bool together = false, still = false;
      if (n > 0.0F) {
        const float mean = sum / n, mean_sq = mean * mean;
        const float noise = prior_->variance[i] + variance_of(prior_->w[i]);
        const float threshold = kMotionSigmas * kMotionSigmas * noise / n;
        if (mean_sq > threshold) shift = mean * (1.0F - threshold / mean_sq);
        const float spread = square / n - mean_sq;
        together = spread <= kTogether * noise;
        const bool as_one = spread <= kTogether * (noise + kMotionError * kMotionError * shift * shift);
        if (as_one && dt_s_ > 0.0F) rate = shift / dt_s_;
        still = n > kMostOfMotion;
      }
      fuse_pixel(i, shift, together, still);
      rate_[i] = rate;
    }
}

void DepthFusion::fuse_pixel(std::size_t i, float shift, bool together, bool still) noexcept {
  const float m = measured_[i], was = prior_->w[i], covered = prior_->hidden[i];
  const float age = prior_->age_s[i] + dt_s_, covered_age = prior_->hidden_age_s[i] + dt_s_;
  float w = was, variance = prior_->variance[i], seen = age, hidden = covered;
  float hidden_age = covered_age;
  if (m > 0.0F) {
    const float noise = variance_of(m);
    const bool follows = together || std::abs(m - was - shift) < std::abs(m - was);
    const float expected = follows ? was + shift : was;
    const float off = m - expected;
    seen = 0.0F;
    if (follows) variance += kMotionError * kMotionError * shift * shift;
    if (was > 0.0F && off * off <= kGateSigmas * kGateSigmas * (variance + noise)) {
      const float gain = std::max(variance / (variance + noise), static_cast<float>(kLeastGain));
      w = expected + gain * off;
      variance = (1.0F - gain) * variance + gain * gain * noise;
    } else if (was > 0.0F && together) {
      // One that disagrees where all around move as one is an error: its, or this image's; the next decides.
      w = expected;
      variance = noise;
    } else if (was > 0.0F && still && !follows && !(prior_->age_s[i] > 0.0F)) {
      // Alone and for the first time: an edge's light hangs now here, now there.
      seen = age;
    } else {
      // Nearer together than one sheet's neighbours they would be one.
      const float slack = kGateSigmas * std::sqrt(2.0F * noise) + steep_ * m;
      if (covered > 0.0F && m <= covered + slack) {
        hidden = 0.0F;  // it came to light, or proved absent
      } else if (was > 0.0F && m > was + slack && !(covered > 0.0F) &&
                 std::abs(off) > kFollowedShare * std::abs(m - was)) {
        hidden = prior_->shown[i];
        hidden_age = age;
      }
      w = m;
      variance = noise;
    }
  } else if (age > static_cast<float>(kBlindSeconds)) {
    w = 0.0F;
  } else if (was > 0.0F && together) {
    // Left behind, a hole in what moves would be a pit.
    w = was + shift;
  }
  if (hidden_age > static_cast<float>(kHiddenSeconds)) hidden = 0.0F;
  now_.w[i] = w;
  now_.variance[i] = variance;
  now_.age_s[i] = seen;
  now_.hidden[i] = hidden;
  now_.hidden_age_s[i] = hidden > 0.0F ? hidden_age : 0.0F;
}

/// Single pixels between two of one sheet that nobody measured lie between them.
void DepthFusion::fill(const PixelWindow& window) noexcept {
  const auto stride = static_cast<std::size_t>(grid_.stride);
  // A filled pixel is blind since ever, so the next image does not fill from it.
  constexpr float kNeverSeen = static_cast<float>(kBlindSeconds);
  for (int v = window.first_row; v < window.last_row; ++v)
    for (std::size_t i = grid_.index(window.first_column, v),
                     end = i + static_cast<std::size_t>(window.columns());
         i < end; ++i) {
      if (now_.w[i] > 0.0F) continue;
      for (const std::size_t step : {std::size_t{1}, stride}) {
        const float a = now_.w[i - step], b = now_.w[i + step];
        if (!(a > 0.0F && b > 0.0F) || now_.age_s[i - step] >= kNeverSeen ||
            now_.age_s[i + step] >= kNeverSeen ||
            std::abs(a - b) > static_cast<float>(grid_.reach(static_cast<double>(std::min(a, b)), 1.0)))
          continue;
        now_.w[i] = 0.5F * (a + b);
        now_.variance[i] = kFilledVariance * variance_of(a);
        now_.age_s[i] = kNeverSeen;
        break;
      }
    }
}

/// Links neighbours of one sheet: they differ by no more than noise and a slope that the pixels beyond them
/// show as well.
void DepthFusion::link(const PixelWindow& window) noexcept {
  const float pixel = 1.0F / static_cast<float>(camera_.fx_px);
  for (int v = window.first_row; v < window.last_row; ++v) {
    const std::size_t first = grid_.index(window.first_column, v);
    for (const bool across : {true, false}) {
      const std::ptrdiff_t step = across ? 1 : grid_.stride;
      const float* const w = now_.w.data() + first;
      const float* const p = now_.variance.data() + first;
      std::uint8_t* const out = (across ? now_.right : now_.below).data() + first;
      for (std::ptrdiff_t k = 0; k < window.columns(); ++k) {
        const float a = w[k], b = w[k + step], before = w[k - step], after = w[k + 2 * step];
        const float d = b - a, size = std::abs(d), sign = d < 0.0F ? -1.0F : 1.0F;
        const float same_before = before > 0.0F ? sign * (a - before) : 0.0F;
        const float same_after = after > 0.0F ? sign * (after - b) : 0.0F;
        const float scale = pixel * std::min(a, b);
        const float witnessed = std::min(kSteepening * std::max(same_before, same_after),
                                         static_cast<float>(kSteepestSlope) * scale);
        const float beyond = size - std::max(kPlainSlope * scale, witnessed);
        const bool explained =
            beyond <= 0.0F || beyond * beyond <= kGateSigmas * kGateSigmas * (p[k] + p[k + step]);
        out[k] = static_cast<std::uint8_t>(static_cast<int>(explained) & static_cast<int>(a > 0.0F) &
                                           static_cast<int>(b > 0.0F));
      }
    }
  }
}

namespace {

/// Means over a pixel and the pairs around it that links reach, along one axis.
template <int kRadius>
void mean_of_pairs(const float* in, const std::uint8_t* linked, std::ptrdiff_t step, std::ptrdiff_t n,
                   float* out) noexcept {
  for (std::ptrdiff_t k = 0; k < n; ++k) {
    float both = 1.0F, sum = in[k], count = 1.0F;
    for (std::ptrdiff_t r = 1; r <= kRadius; ++r) {
      both *= static_cast<float>(linked[k + (r - 1) * step] & linked[k - r * step]);
      sum += both * (in[k - r * step] + in[k + r * step]);
      count += 2.0F * both;
    }
    out[k] = sum / count;
  }
}
using MeanOfPairs = void (*)(const float*, const std::uint8_t*, std::ptrdiff_t, std::ptrdiff_t,
                             float*) noexcept;
constexpr MeanOfPairs kMeans[] = {mean_of_pairs<0>, mean_of_pairs<1>, mean_of_pairs<2>, mean_of_pairs<3>};
static_assert(std::size(kMeans) == kLargestRadius + 1);

}  // namespace

void DepthFusion::smooth(const PixelWindow& window) noexcept {
  const MeanOfPairs mean = kMeans[radius_];
  for (int v = window.first_row; v < window.last_row; ++v) {
    const std::size_t i = grid_.index(window.first_column, v);
    mean(now_.w.data() + i, now_.right.data() + i, 1, window.columns(), half_.data() + i);
  }
  for (int v = window.first_row; v < window.last_row; ++v) {
    const std::size_t i = grid_.index(window.first_column, v);
    mean(half_.data() + i, now_.below.data() + i, grid_.stride, window.columns(), now_.shown.data() + i);
  }
}

void DepthFusion::write(const PixelWindow& window, DepthSheets& sheets) const noexcept {
  const std::ptrdiff_t stride = grid_.stride;
  for (int v = window.first_row; v < window.last_row; ++v) {
    const std::size_t first = grid_.index(window.first_column, v);
    const std::uint8_t *const right = now_.right.data() + first, *const below = now_.below.data() + first;
    const float *const shown = now_.shown.data() + first, *const hidden = now_.hidden.data() + first;
    for (std::ptrdiff_t k = 0; k < window.columns(); ++k) {
      const int e = right[k], w = right[k - 1], s = below[k], n = below[k - stride];
      // A corner is linked by either way around.
      const int se = (e & below[k + 1]) | (s & right[k + stride]),
                sw = (w & below[k - 1]) | (s & right[k + stride - 1]);
      const int ne = (e & below[k + 1 - stride]) | (n & right[k - stride]),
                nw = (w & below[k - 1 - stride]) | (n & right[k - stride - 1]);
      const int count = e + w + s + n + se + sw + ne + nw;
      const std::size_t i = first + static_cast<std::size_t>(k);
      sheets.links[i] =
          static_cast<std::uint8_t>(e | w << 1 | s << 2 | n << 3 | se << 4 | sw << 5 | ne << 6 | nw << 7);
      // Between two others and of neither: the light of both, or a surface seen edge on.
      const auto mixed = [shown, k](int low, int high, std::ptrdiff_t step) noexcept {
        const float a = shown[k - step], b = shown[k + step];
        return low + high == 0 && a > 0.0F && b > 0.0F && (shown[k] - a) * (b - shown[k]) > 0.0F;
      };
      const bool surface = count >= kLeastLinks && !mixed(w, e, 1) && !mixed(n, s, stride);
      sheets.front[i] = surface ? shown[k] : 0.0F;
      sheets.rate[i] = rate_[i];
      sheets.hidden[i] = hidden[k];
    }
  }
}

}  // namespace palpate::depth_surface
