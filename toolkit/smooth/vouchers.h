// Patches that have points on all sides of places on them: what lies there is no border, and the points
// themselves need not be asked.
#pragma once

#include <vector>

#include "toolkit/smooth/cover.h"

namespace palpate::render {

/// Those of one sheet in one cube. Scratch that is used again from cube to cube. Keeps pointers.
class Vouchers {
 public:
  /// Begins with none, in a cube with its middle there.
  void begin(const Vec3& middle) {
    middle_ = middle;
    all_.clear();
  }
  void add(const Patch& patch);
  /// Whether some patch has points on all sides of a place, told from the cube's middle.
  [[nodiscard]] bool vouch_for(const Vec3& foot);

 private:
  /// A patch, and where the cube's middle is over it, in shares of what it reached.
  struct Voucher {
    Vec3 u, v;
    double a, b;
    double most;  ///< no place farther off is told of
    const Patch* patch;
  };
  Vec3 middle_ = Vec3::Zero();
  std::vector<Voucher> all_;
};

}  // namespace palpate::render
