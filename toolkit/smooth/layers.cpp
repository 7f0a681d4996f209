#include "toolkit/smooth/layers.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace palpate::render {
namespace {

constexpr std::size_t kLayers = kMostLayers;
/// A place is beyond a layer by more than rounding, in voxels.
constexpr double kBeyond = 1e-6;
/// Layers that meet at less than two degrees hold as one: sine squared of the angle, or the determinant.
constexpr double kLeastSineSq = 1e-3;
/// So near to the sheet a layer may count a little farther on, in voxels.
constexpr float kNextTo = 0.5f;

/// The layers' distances, and which of them count.
struct Found {
  std::array<float, kLayers> value{};
  std::array<std::size_t, kLayers> body{};      ///< of each layer
  std::array<std::size_t, kLayers> greatest{};  ///< layer of each body
  std::size_t layers = 0, bodies = 0;
  std::size_t counts = 0;  ///< the layer
};

template <class Value>
Found find(const Brick* first, Value&& value) noexcept {
  Found f;
  bool begins = true;
  for (std::size_t k = 0; k < kLayers; ++k) {
    f.value[k] = value(first[k], k);
    f.body[k] = f.bodies;
    if (begins || f.value[k] > f.value[f.greatest[f.bodies]]) f.greatest[f.bodies] = k;
    f.layers = k + 1;
    const Joint joint = first[k].joint();
    begins = joint != Joint::kRidge;
    if (begins) ++f.bodies;
    if (joint == Joint::kLast) break;
  }
  f.counts = f.greatest[0];
  for (std::size_t b = 1; b < f.bodies; ++b)
    if (f.value[f.greatest[b]] < f.value[f.counts]) f.counts = f.greatest[b];
  return f;
}

struct Jets {
  std::array<Jet, kLayers> of;
  Found found;
};
/// Of the sides of a seam, or of two that cross, that which counts.
const Brick& seam_side(const Brick* first, const BrickPlace& at) noexcept {
  std::array<float, 3> x;
  for (std::size_t a = 0; a < 3; ++a) x[a] = static_cast<float>(at.cell[a]) + at.t[a];
  std::size_t side = first[1].is_past(x) ? 1 : 0;
  if (first[1].joint() == Joint::kSeam && first[2].is_past(x)) side += 2;
  return first[side];
}

Jets jets_at(const Brick* first, const BrickPlace& at) noexcept {
  Jets j;
  if (first->joint() == Joint::kSeam) {
    j.of[0] = spline_jet(seam_side(first, at), at);
    j.found.value[0] = j.of[0].value;
    j.found.layers = j.found.bodies = 1;
    return j;
  }
  j.found = find(first, [&](const Brick& brick, std::size_t k) {
    j.of[k] = spline_jet(brick, at);
    return j.of[k].value;
  });
  return j;
}

/// The half space that a layer leaves free: places x from here with n . x >= b.
struct Wall {
  Vec3 n;
  double b = 0.0;
  double per_slope = 1.0;
  double behind = 0.0;  ///< by how much d is beyond it
};

/// What holds a god object on a side, and its step.
class Held {
 public:
  Held(const Jets& jets, const Vec3& d, double side) noexcept : jets_(jets), d_(d), side_(side) {
    const Found& f = jets.found;
    add(f.counts);
    if (side > 0.0) {
      for (std::size_t b = 0; b < f.bodies; ++b)
        if (f.greatest[b] != f.counts) add(f.greatest[b]);
    } else {
      for (std::size_t k = 0; k < f.layers; ++k)
        if (k != f.counts && f.body[k] == f.body[f.counts]) add(k);
    }
  }
  [[nodiscard]] NewtonStep step(double longest, bool exact) const noexcept {
    for (std::size_t i = 0; i < count_; ++i)
      if (alone(i)) return newton_step(jets_.of[layer_[i]], d_, longest, exact);
    NewtonStep s;
    for (std::size_t i = 1; i < count_; ++i)
      for (std::size_t j = 0; j < i; ++j)
        if (on_both(i, j, longest, exact, s)) return s;
    for (std::size_t i = 2; i < count_; ++i)
      for (std::size_t j = 1; j < i; ++j)
        for (std::size_t k = 0; k < j; ++k)
          if (on_three(i, j, k, longest, s)) return s;
    return newton_step(jets_.of[layer_[0]], d_, longest, exact);
  }

 private:
  void add(std::size_t layer) noexcept {
    const Jet& jet = jets_.of[layer];
    const Vec3 g = jet.gradient.cast<double>() * side_;
    const double slope = g.norm();
    if (!(slope > 0.0)) return;
    Wall& w = wall_[count_];
    w.per_slope = 1.0 / slope;
    w.n = g * w.per_slope;
    w.b = -side_ * static_cast<double>(jet.value) * w.per_slope;
    w.behind = w.b - w.n.dot(d_);
    layer_[count_++] = layer;
  }
  /// Whether the place is free for all but those named.
  [[nodiscard]] bool is_free(const Vec3& x, std::size_t i, std::size_t j, std::size_t k) const noexcept {
    for (std::size_t l = 0; l < count_; ++l)
      if (l != i && l != j && l != k && wall_[l].n.dot(x) < wall_[l].b - kBeyond) return false;
    return true;
  }
  [[nodiscard]] bool alone(std::size_t i) const noexcept {
    const Wall& w = wall_[i];
    return w.behind > 0.0 && is_free(d_ + w.n * w.behind, i, i, i);
  }
  /// Along the crease of two: as newton_step(), with what either has of the curvature.
  [[nodiscard]] bool on_both(std::size_t i, std::size_t j, double longest, bool exact,
                             NewtonStep& s) const noexcept {
    const Wall &a = wall_[i], &b = wall_[j];
    const double c = a.n.dot(b.n), sine_sq = 1.0 - c * c;
    if (sine_sq < kLeastSineSq) return false;
    const double push_a = (a.behind - c * b.behind) / sine_sq, push_b = (b.behind - c * a.behind) / sine_sq;
    if (push_a < 0.0 || push_b < 0.0) return false;
    const Vec3 push = a.n * push_a + b.n * push_b;
    if (!is_free(d_ + push, i, j, j)) return false;
    const Vec3 e = a.n.cross(b.n) / std::sqrt(sine_sq);
    const Vec3 onto = (a.n * (a.b - c * b.b) + b.n * (b.b - c * a.b)) / sine_sq;
    double bend = 1.0;
    if (exact)
      bend -= side_ * (push_a * a.per_slope * second(jets_.of[layer_[i]], e) +
                       push_b * b.per_slope * second(jets_.of[layer_[j]], e));
    s = step_to(onto + e * (e.dot(d_) / std::max(bend, kLeastCurvature)), push, longest);
    return true;
  }
  [[nodiscard]] bool on_three(std::size_t i, std::size_t j, std::size_t k, double longest,
                              NewtonStep& s) const noexcept {
    Mat3 n;
    n << wall_[i].n.transpose(), wall_[j].n.transpose(), wall_[k].n.transpose();
    if (std::abs(n.determinant()) < kLeastSineSq) return false;
    const Vec3 x = n.inverse() * Vec3(wall_[i].b, wall_[j].b, wall_[k].b);
    const Vec3 push = n.transpose().inverse() * (x - d_);
    if (push.minCoeff() < 0.0 || !is_free(x, i, j, k)) return false;
    s = step_to(x, x - d_, longest);
    return true;
  }
  /// `push`: from d to where it is free.
  [[nodiscard]] NewtonStep step_to(Vec3 x, const Vec3& push, double longest) const noexcept {
    const double length = x.norm();
    if (length > longest) x *= longest / length;
    NewtonStep s;
    const double size = push.norm();
    s.normal = size > 0.0 ? Vec3(push * (side_ / size)) : Vec3(wall_[0].n * side_);
    s.lift = x.dot(s.normal);
    s.along = x - s.normal * s.lift;
    return s;
  }
  [[nodiscard]] static double second(const Jet& jet, const Vec3& e) noexcept {
    const auto& h = jet.second;
    const auto at = [&](std::size_t i) { return static_cast<double>(h[i]); };
    return at(0) * e.x() * e.x() + at(1) * e.y() * e.y() + at(2) * e.z() * e.z() +
           2.0 * (at(3) * e.x() * e.y() + at(4) * e.x() * e.z() + at(5) * e.y() * e.z());
  }

  const Jets& jets_;
  Vec3 d_;
  double side_;
  std::size_t count_ = 0;
  std::array<Wall, kLayers> wall_;
  std::array<std::size_t, kLayers> layer_{};
};

}  // namespace

float layers_value(const Brick* first, const BrickPlace& at) noexcept {
  if (first->joint() == Joint::kSeam) return spline_value(seam_side(first, at), at);
  const Found f = find(first, [&](const Brick& brick, std::size_t) { return spline_value(brick, at); });
  return f.value[f.counts];
}

Jet layers_jet(const Brick* first, const BrickPlace& at) noexcept {
  const Jets jets = jets_at(first, at);
  return jets.of[jets.found.counts];
}

Jet layers_jet_along(const Brick* first, const BrickPlace& at, const Vec3& normal) noexcept {
  const Jets jets = jets_at(first, at);
  const Found& f = jets.found;
  const float value = f.value[f.counts];
  std::size_t best = f.counts;
  double most = -2.0;
  for (std::size_t k = 0; k < f.layers; ++k) {
    if (std::abs(f.value[k] - value) > kNextTo) continue;
    const double agreed = jets.of[k].gradient.cast<double>().normalized().dot(normal);
    if (!(agreed > most)) continue;
    most = agreed;
    best = k;
  }
  Jet jet = jets.of[best];
  jet.value = value;
  return jet;
}

Vec3 layers_normal(const Brick* first, const BrickPlace& at, float reach) noexcept {
  const Jets jets = jets_at(first, at);
  const Found& f = jets.found;
  Vec3 sum = Vec3::Zero();
  for (std::size_t k = 0; k < f.layers; ++k)
    if (std::abs(f.value[k] - f.value[f.counts]) <= reach)
      sum += jets.of[k].gradient.cast<double>().normalized();
  return sum.normalized();
}

NewtonStep layers_step(const Brick* first, const BrickPlace& at, const Vec3& d, double side, double longest,
                       bool exact) noexcept {
  const Jets jets = jets_at(first, at);
  return Held(jets, d, side).step(longest, exact);
}

}  // namespace palpate::render
