// What the hunt turns: a small model, edits of its points, a renderer's options and a way of the HIP, as a
// value that is drawn at random, changed a little, and written as text.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/random.h"
#include "toolkit/core/vec.h"

namespace palpate::experiments {

/// A point of the model, put elsewhere.
struct PointEdit {
  enum class Kind : std::uint8_t { kMove, kDouble, kDrop, kOnto } kind = Kind::kMove;
  double which = 0.0;      ///< share of the points, [0, 1)
  double other = 0.0;      ///< kOnto: the point that it is put on
  Vec3 by = Vec3::Zero();  ///< spacings
};

/// Where the HIP goes next.
struct Waypoint {
  enum class Kind : std::uint8_t { kFree, kAtPoint, kBetween } kind = Kind::kFree;
  Vec3 at = Vec3::Zero();           ///< kFree: halves of the box from its middle; else spacings off the place
  double which = 0.0, other = 0.0;  ///< points, shares as in PointEdit
  int frames = 1;                   ///< on the way there
};

/// One thing to be tried. The HIP starts above the model and returns there.
struct Quarry {
  std::string shape;  ///< a generator
  int points = 0;
  std::string sampling;  ///< of the generator
  double noise = 0.0, outliers = 0.0;
  std::uint64_t model_seed = 1;
  double scale = 1.0;   ///< of all lengths
  double offset = 0.0;  ///< of the model from the origin, in its own sizes
  double friction = 0.0;
  std::vector<PointEdit> edits;
  std::vector<Waypoint> way;
  Options options;  ///< of the renderer, as given

  /// As after a scene's name on the command line.
  [[nodiscard]] std::string model_text() const;
};

/// Frames that the ways of one quarry may have together; what is longer is cut.
inline constexpr int kMostFrames = 1500;

[[nodiscard]] Quarry random_quarry(Random& random, std::span<const OptionSpec> options);
/// One to three things changed.
[[nodiscard]] Quarry mutated(const Quarry& quarry, Random& random, std::span<const OptionSpec> options);

[[nodiscard]] std::string to_text(const Quarry& quarry);
/// False where the text is not one of to_text().
[[nodiscard]] bool from_text(const std::string& text, Quarry& quarry);

}  // namespace palpate::experiments
