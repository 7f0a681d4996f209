#include "experiments/benchmarks/felt_surface/slice.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <optional>

#include <palpate/generate.h>
#include <palpate/result.h>
#include "toolkit/core/atomic_file.h"
#include "toolkit/core/message_text.h"

namespace palpate::felt {
namespace {

/// A slice of the plane y = 0. The probe moves along `down` in every column.
struct View {
  std::string name, title, generate;
  Vec3 middle, down;
  double wide_mm = 4.0, high_mm = 2.0;
};

const std::vector<View>& views() {
  static const std::vector<View> kAll = {
      {"edge",
       "a round edge of 2 mm",
       "rounded-box:points=15000:sampling=blue:mesh=false",
       {18.4, 0, 8.4},
       Vec3(-1, 0, -1).normalized(),
       7.0,
       3.0},
      {"hole",
       "the rim of a mouth, to the left of it nothing",
       "bowl:rim_deg=150:felt=outside:points=12000:sampling=blue:mesh=false",
       {12.5, 0, 21.65},
       Vec3(-0.5, 0, -std::sqrt(0.75)),
       8.0,
       3.5},
      {"thin",
       "two sheets a spacing and a half apart",
       "shells:extent_mm=32:gap_mm=0.6:points=40000:sampling=blue:mesh=false",
       {0, 0, 15.7},
       {0, 0, -1},
       5.0,
       2.2},
      {"noise",
       "noise of .22 spacings",
       "torus:points=60000:sampling=blue:noise=0.22:mesh=false",
       {37.037, 0, 12.963},
       {0, 0, -1},
       7.0,
       3.0},
  };
  return kAll;
}

constexpr int kColumns = 280, kSteps = 240;
/// Jumps between two columns above this share of the width are drawn as gaps.
constexpr double kGap = 0.05;
constexpr double kPixelsWide = 900.0, kLegendPixels = 24.0;
constexpr std::array kColours = {"#c0392b", "#2471a3", "#7d3c98", "#b9770e", "#117a65", "#5d6d7e"};

using Locus = std::vector<std::optional<Vec3>>;

class Canvas {
 public:
  explicit Canvas(const View& view)
      : view_(view), across_(-view.down.z(), 0.0, view.down.x()), scale_(kPixelsWide / view.wide_mm) {
    // Rightwards, seen with the probe coming from above.
    if (across_.x() < 0.0) across_ = -across_;
  }
  [[nodiscard]] double pixels_high() const { return view_.high_mm * scale_; }
  /// The probe's path in a column, from its free end.
  [[nodiscard]] Vec3 place(int column, double share_down) const {
    const double x = (static_cast<double>(column) + 0.5) / kColumns - 0.5;
    return view_.middle + x * view_.wide_mm * across_ + (share_down - 0.5) * view_.high_mm * view_.down;
  }
  [[nodiscard]] std::string at(const Vec3& p) const {
    const Vec3 r = p - view_.middle;
    return fmt::format("{:.1f},{:.1f}", 0.5 * kPixelsWide + scale_ * r.dot(across_),
                       0.5 * pixels_high() + scale_ * r.dot(view_.down));
  }
  void points(const cloud::Cloud& cloud, double thick_mm) {
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3 p = cloud.point_mm(i), r = p - view_.middle;
      if (std::abs(p.y()) > thick_mm || std::abs(r.dot(across_)) > 0.5 * view_.wide_mm ||
          std::abs(r.dot(view_.down)) > 0.5 * view_.high_mm)
        continue;
      const std::string at_pixel = at(p);
      const std::size_t comma = at_pixel.find(',');
      body_ += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"2.5\" fill=\"#999\"/>\n",
                           at_pixel.substr(0, comma), at_pixel.substr(comma + 1));
    }
  }
  void locus(const Locus& locus, const std::string& label, const char* colour, double width) {
    std::string line;
    std::optional<Vec3> last;
    const auto end_line = [&] {
      if (!line.empty())
        body_ += fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"/>\n",
                             line, colour, width);
      line.clear();
    };
    for (const std::optional<Vec3>& p : locus) {
      if (last && (!p || (*p - *last).norm() > kGap * view_.wide_mm)) end_line();
      if (p) line += at(*p) + " ";
      last = p;
    }
    end_line();
    legend_ += fmt::format("<text x=\"{:.0f}\" y=\"{:.0f}\" fill=\"{}\">{}</text>\n",
                           10.0 + 170.0 * labels_++, pixels_high() + 0.7 * kLegendPixels, colour, label);
  }
  [[nodiscard]] std::string svg() const {
    const double high = pixels_high() + kLegendPixels;
    return fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.0f} {1:.0f}\" width=\"{0:.0f}\" "
        "height=\"{1:.0f}\" font-family=\"sans-serif\" font-size=\"14\">\n<title>{2}</title>\n"
        "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        "<clipPath id=\"window\"><rect width=\"{0:.0f}\" height=\"{3:.0f}\"/></clipPath>\n"
        "<g clip-path=\"url(#window)\">\n{4}</g>\n{5}"
        "<path d=\"M{6:.0f},{7:.0f} h{8:.1f}\" stroke=\"black\" stroke-width=\"2\"/>\n"
        "<text x=\"{6:.0f}\" y=\"{9:.0f}\">1 mm</text>\n</svg>\n",
        kPixelsWide, high, view_.title, pixels_high(), body_, legend_, 10.0, pixels_high() - 10.0, scale_,
        pixels_high() - 16.0);
  }

 private:
  const View& view_;
  Vec3 across_;
  double scale_;
  int labels_ = 0;
  std::string body_, legend_;
};

/// God object of the first contact frame per column.
Locus touched(render::HapticRenderer& renderer, const Canvas& canvas) {
  Locus locus(kColumns);
  for (int column = 0; column < kColumns; ++column) {
    renderer.restart(canvas.place(column, 0.0), -kStepS);
    for (int k = 0; k <= kSteps; ++k) {
      const render::Frame frame =
          renderer.step(canvas.place(column, static_cast<double>(k) / kSteps), kStepS * k);
      if (!frame.contact) continue;
      locus[static_cast<std::size_t>(column)] = frame.god_object_mm;
      break;
    }
  }
  return locus;
}

}  // namespace

Status draw_slice(const std::string& name, const std::vector<Tried>& renderers,
                  const render::Registry& registry, const std::string& file) {
  const View* view = nullptr;
  for (const View& one : views())
    if (one.name == name) view = &one;
  if (view == nullptr)
    return Error{
        fmt::format("there is no slice '{}'", name), "choose from " + joined(names_of(views())), {}, 0};
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(parse_named_options(view->generate).value()));
  render::ModelInput model;
  model.name = name;
  model.cloud = std::make_shared<const cloud::Cloud>(made.cloud);
  model.surface.stiffness_n_per_mm = kStiffness;
  render::SceneInput scene;
  scene.models.push_back(model);

  Canvas canvas(*view);
  canvas.points(made.cloud, 0.5 * made.nominal_spacing_mm);
  Locus truth(kColumns);
  for (int column = 0; column < kColumns; ++column)
    if (const auto entry = made.surface->first_entry(canvas.place(column, 0.0), canvas.place(column, 1.0)))
      truth[static_cast<std::size_t>(column)] = entry->point_mm;
  canvas.locus(truth, "truth", "#000", 1.0);
  std::size_t colour = 0;
  for (const Tried& tried : renderers) {
    PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                   registry.make(tried.spec.name, tried.spec.options));
    PALPATE_TRY(renderer->prepare(scene, {}));
    canvas.locus(touched(*renderer, canvas), tried.label, kColours[colour++ % kColours.size()], 1.6);
  }
  return write_file(file, canvas.svg());
}

}  // namespace palpate::felt
