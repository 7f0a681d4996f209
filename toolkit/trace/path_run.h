// Runs a renderer along a path, and hashes its answers. Digests of every frame serve comparison.
#pragma once

#include <bit>
#include <cstdint>
#include <ctime>
#include <span>
#include <string>

#include <palpate/motion.h>
#include <palpate/renderer.h>
#include <palpate/trace.h>
#include "toolkit/core/hash.h"

namespace palpate::trace {

inline constexpr std::int64_t kNsPerS = 1'000'000'000;

/// Processor time of the calling thread: what else runs is not in it.
[[nodiscard]] inline std::int64_t thread_cpu_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<std::int64_t>(now.tv_sec) * kNsPerS + now.tv_nsec;
}

/// A renderer along a path and its simulation; the models advance first.
class PathRun {
 public:
  PathRun(render::HapticRenderer& renderer, const PathView& path, render::Simulation* simulation)
      : renderer_(renderer), path_(path), simulation_(simulation) {}

  /// Back to one step before the first sample's time.
  void restart() noexcept {
    const double step_s = path_.size() > 1 ? path_.t_s[1] - path_.t_s[0] : kNominalDtS;
    const double start_s = path_.t_s[0] - step_s;
    if (simulation_ != nullptr) {
      simulation_->reset();
      simulation_->advance(start_s);
    }
    renderer_.restart(path_.hip_mm[0], start_s);
  }
  /// Moves the models to sample i. Before each frame, untimed.
  void advance(std::size_t i) noexcept {
    if (simulation_ != nullptr) simulation_->advance(path_.t_s[i]);
  }
  render::Frame step(std::size_t i) noexcept { return renderer_.step(path_.hip_mm[i], path_.t_s[i]); }
  /// The first sample after `i` before which something moves, else the path's end.
  [[nodiscard]] std::size_t static_until(std::size_t i) const noexcept {
    if (simulation_ == nullptr) return path_.size();
    const double next_s = simulation_->next_s();
    std::size_t end = i + 1;
    while (end < path_.size() && path_.t_s[end] < next_s) ++end;
    return end;
  }
  [[nodiscard]] std::size_t size() const noexcept { return path_.size(); }

 private:
  static constexpr double kNominalDtS = 1e-3;  // dt of a path with one sample
  render::HapticRenderer& renderer_;
  PathView path_;
  render::Simulation* simulation_;
};

/// A cheap order-dependent sum of the bits that trace_hash covers. Timed passes use it to prove equal
/// answers, at about 2 ns a frame and without writing a second trace through the caches.
class FrameDigest {
 public:
  void add(const render::Frame& frame) noexcept {
    // Odd constants from fractional square roots of primes (SHA-512's initial words, made odd).
    const std::uint64_t sum =
        bits(frame.force_n.x()) * 0x6A09E667F3BCC909u + bits(frame.force_n.y()) * 0xBB67AE8584CAA73Bu +
        bits(frame.force_n.z()) * 0x3C6EF372FE94F82Bu + bits(frame.god_object_mm.x()) * 0xA54FF53A5F1D36F1u +
        bits(frame.god_object_mm.y()) * 0x510E527FADE682D1u +
        bits(frame.god_object_mm.z()) * 0x9B05688C2B3E6C1Fu + (frame.contact ? 0x1F83D9ABFB41BD6Bu : 0u);
    state_ = std::rotl(state_, 1) + sum;
  }
  [[nodiscard]] std::uint64_t value() const noexcept { return state_; }

 private:
  static std::uint64_t bits(double v) noexcept { return std::bit_cast<std::uint64_t>(v); }
  std::uint64_t state_ = 0;
};

[[nodiscard]] inline std::uint64_t digest_of(std::span<const render::Frame> frames) noexcept {
  FrameDigest digest;
  for (const render::Frame& frame : frames) digest.add(frame);
  return digest.value();
}

/// FNV-1a-64 over contact, force and god object of every added frame; used by trace_hash().
class FrameHash {
 public:
  void add(const render::Frame& frame) noexcept {
    hash_.byte(frame.contact ? 1 : 0);
    for (int axis = 0; axis < 3; ++axis) hash_.real(frame.force_n[axis]);
    for (int axis = 0; axis < 3; ++axis) hash_.real(frame.god_object_mm[axis]);
  }
  /// Sixteen hexadecimal digits.
  [[nodiscard]] std::string hex() const { return hash_.hex(); }

 private:
  Hash64 hash_;
};

}  // namespace palpate::trace
