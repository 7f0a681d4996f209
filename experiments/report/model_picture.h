// Picture of a model: its points as shaded discs, seen from above and from one side.
#pragma once

#include <vector>

#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "experiments/report/figures.h"
#include "experiments/study/study.h"

namespace palpate::experiments {

/// A parallel projection of the world onto a picture.
class ModelView {
 public:
  /// All of `box` fits, with a margin.
  ModelView(const geometry::Aabb& box, int width, int height);
  /// Pixels from the left and from the top; and mm towards the viewer.
  struct Seen {
    double x = 0.0, y = 0.0, near_mm = 0.0;
  };
  [[nodiscard]] Seen seen(const Vec3& world_mm) const;
  [[nodiscard]] const Vec3& right() const { return right_; }
  [[nodiscard]] const Vec3& up() const { return up_; }
  [[nodiscard]] const Vec3& towards() const { return towards_; }
  [[nodiscard]] double pixels_per_mm() const { return scale_; }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

 private:
  Vec3 right_, up_, towards_, centre_mm_;
  double scale_ = 1.0;
  int width_, height_;
};

/// The points of all models as discs on their local planes, lit from the left and above; white where nothing
/// is. O(points).
[[nodiscard]] GreyImage draw_models(const std::vector<ModelSample>& models, const ModelView& view);

/// The picture of a study: the models with the path over them, and where there is a truth the same for every
/// renderer, with what is wrong along the path in colour. Empty `svg` where there is no sample.
[[nodiscard]] Figure model_figure(const Study& study, const std::string& prefix);

}  // namespace palpate::experiments
