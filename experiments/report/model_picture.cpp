#include "experiments/report/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>

#include "experiments/report/tables.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/statistics.h"
#include "toolkit/search/knn.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::experiments {
namespace {

constexpr int kOneThread = 1;  // a sample takes milliseconds

/// Where the viewer stands: above, and to the front left.
constexpr double kElevationDeg = 42.0, kAzimuthDeg = -60.0;
constexpr double kRadPerDeg = 0.017453292519943295769;  // pi / 180
constexpr double kMargin = 0.04;                        // of the picture, on every side

/// A disc reaches as far as the eighth neighbour of most points, so that no gap is seen between them.
constexpr double kDiscPerEighth = 0.8;
constexpr double kLeastDisc = 0.8, kMostDisc = 14.0;  // pixels
constexpr double kSteepest = 0.25;                    // of a normal towards the viewer: a disc is no spike

constexpr double kDarkest = 70.0, kBrightest = 236.0;  // leaves white to the paper, and black to the path

std::uint8_t shade(const Vec3& normal, const ModelView& view) {
  const Vec3 light = (view.towards() + 0.7 * view.up() - 0.9 * view.right()).normalized();
  const double lit = std::max(0.0, normal.dot(light));
  return static_cast<std::uint8_t>(std::lround(kDarkest + (kBrightest - kDarkest) * lit));
}

/// Fills one disc on its plane; what is nearer stays.
void splat(const ModelView& view, const Vec3& at_mm, const Vec3& normal, double radius, GreyImage& image,
           std::vector<float>& nearest) {
  const ModelView::Seen centre = view.seen(at_mm);
  const double facing = std::max(normal.dot(view.towards()), kSteepest);
  // Depth over the picture: the plane's slope to the right and upward.
  const double right = -normal.dot(view.right()) / facing / view.pixels_per_mm();
  const double up = -normal.dot(view.up()) / facing / view.pixels_per_mm();
  const std::uint8_t grey = shade(normal, view);
  const auto from = [](double c, double r) { return static_cast<int>(std::ceil(c - r)); };
  for (int y = std::max(0, from(centre.y, radius)); y < image.height && y <= centre.y + radius; ++y)
    for (int x = std::max(0, from(centre.x, radius)); x < image.width && x <= centre.x + radius; ++x) {
      const double dx = x - centre.x, dy = y - centre.y;
      if (dx * dx + dy * dy > radius * radius) continue;
      const auto depth = static_cast<float>(centre.near_mm + right * dx - up * dy);
      const std::size_t i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x);
      if (depth <= nearest[i]) continue;
      nearest[i] = depth;
      image.pixels[i] = grey;
    }
}

void draw_model(const cloud::Cloud& points, const ModelView& view, GreyImage& image,
                std::vector<float>& nearest) {
  if (points.empty()) return;
  const search::NeighbourTable table = search::exact_knn(points, kOneThread);
  std::vector<surface::OrientedPoint> planes = surface::surface_points(points);
  surface::fit_planes(planes, table.of, kOneThread);
  std::vector<Vec3> normals = surface::normals_of(planes);
  std::vector<double> reach;
  for (std::size_t i = 0; i < points.size(); ++i)
    reach.push_back((points.local_mm(table.of[i].back()) - points.local_mm(i)).norm());
  const double radius = std::clamp(kDiscPerEighth * upper_median(std::move(reach)) * view.pixels_per_mm(),
                                   kLeastDisc, kMostDisc);
  for (std::size_t i = 0; i < points.size(); ++i) {
    Vec3& normal = normals[i];
    if (normal == Vec3::Zero()) normal = view.towards();
    if (normal.dot(view.towards()) < 0.0) normal = -normal;
    splat(view, points.point_mm(i), normal, radius, image, nearest);
  }
}

}  // namespace

ModelView::ModelView(const geometry::Aabb& box, int width, int height) : width_(width), height_(height) {
  const double elevation = kElevationDeg * kRadPerDeg, azimuth = kAzimuthDeg * kRadPerDeg;
  towards_ = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
              std::sin(elevation)};
  right_ = Vec3::UnitZ().cross(towards_).normalized();
  up_ = towards_.cross(right_);
  centre_mm_ = box.centre_mm();
  const Vec3 half = 0.5 * box.extent_mm();
  const double wide = half.dot(right_.cwiseAbs()), high = half.dot(up_.cwiseAbs());
  const double room = 0.5 - kMargin;
  scale_ = std::min(wide > 0.0 ? room * width / wide : std::numeric_limits<double>::infinity(),
                    high > 0.0 ? room * height / high : std::numeric_limits<double>::infinity());
  if (!std::isfinite(scale_)) scale_ = 1.0;
}

ModelView::Seen ModelView::seen(const Vec3& world_mm) const {
  const Vec3 d = world_mm - centre_mm_;
  return {0.5 * width_ + scale_ * d.dot(right_), 0.5 * height_ - scale_ * d.dot(up_), d.dot(towards_)};
}

GreyImage draw_models(const std::vector<ModelSample>& models, const ModelView& view) {
  constexpr std::uint8_t kPaper = 255;
  GreyImage image{view.width(), view.height(), {}};
  const auto pixels = static_cast<std::size_t>(view.width()) * static_cast<std::size_t>(view.height());
  image.pixels.assign(pixels, kPaper);
  std::vector<float> nearest(pixels, -std::numeric_limits<float>::infinity());
  for (const ModelSample& model : models) draw_model(model.points, view, image, nearest);
  return image;
}

namespace {

// The picture of a study: one SVG with the shaded models in it once, shown again in every panel.

constexpr int kPanelWidth = 360, kModelPanelHeight = 250, kTitleHeight = 24, kModelGap = 14;
constexpr int kAloneWidth = 720, kAloneHeight = 420;  // one panel that has the page to itself
constexpr int kMostColumns = 3, kLegendHeight = 26;
constexpr int kImagePerUnit = 2;             // pixels of the image a unit of the picture: sharp on paper too
constexpr std::size_t kPathVertices = 2500;  // a weave keeps its curves
constexpr double kTenths = 10.0;             // places are written to a tenth of a unit

/// Kinds of a drawn piece of the path, the worst last.
struct Level {
  const char* colour;
  double width;
};
constexpr std::array<Level, 4> kErrors = {
    {{"#f2c14e", 2.0}, {"#f08a24", 2.2}, {"#d9480f", 2.4}, {"#8b1a1a", 2.6}}};
constexpr Level kMissed = {"#000000", 3.4}, kFalse = {"#7b2cbf", 3.4};
constexpr double kLevelFactor = 4.0;  // each is up to so many times the one before

geometry::Aabb box_of(const Study& study) {
  geometry::Aabb box;
  for (const ModelSample& model : study.models)
    for (std::size_t i = 0; i < model.points.size(); ++i) box.add(model.points.point_mm(i));
  if (box.empty()) return box;
  for (const Vec3& hip : study.path.hip_mm) box.add(hip);
  return box;
}

std::size_t step_of(const Study& study) {
  return std::max<std::size_t>(1, study.path.size() / kPathVertices);
}

std::string at(const ModelView& view, const Vec3& hip_mm) {
  const ModelView::Seen seen = view.seen(hip_mm);
  const auto tenths = [](double v) { return std::round(v * kTenths) / kTenths; };
  return fmt::format("{:g} {:g}", tenths(seen.x), tenths(seen.y));
}

/// The whole path, thin.
std::string whole_path(const Study& study, const ModelView& view) {
  std::string d;
  for (std::size_t k = 0; k < study.path.size(); k += step_of(study))
    d += (d.empty() ? "M" : "L") + at(view, study.path.hip_mm[k]);
  return d;
}

/// The pieces of the path for which `is` holds of any frame, as the data of one SVG path.
template <class Is>
std::string pieces(const Study& study, const ModelView& view, const Is& is) {
  const std::size_t step = step_of(study), n = study.path.size();
  std::string d;
  bool open = false;
  for (std::size_t k = 0; k < n; k += step) {
    const std::size_t end = std::min(k + step, n);
    bool any = false;
    for (std::size_t i = k; i < end && !any; ++i) any = is(i);
    if (!any) {
      open = false;
      continue;
    }
    if (!open) d += "M" + at(view, study.path.hip_mm[k]);
    d += "L" + at(view, study.path.hip_mm[std::min(end, n - 1)]);
    open = true;
  }
  return d;
}

std::string stroke(const std::string& d, const Level& level) {
  return d.empty() ? std::string()
                   : fmt::format("<path d=\"{}\" stroke=\"{}\" stroke-width=\"{}\"/>", d, level.colour,
                                 level.width);
}

/// The smallest force that a device shows; all renderers have the same.
double floor_of(const Study& study) {
  double floor = 0.0;
  for (const metrics::RendererResult& r : study.document.renderers)
    if (r.accuracy) floor = std::max(floor, r.accuracy->floor_n);
  return floor;
}

/// 0: no more than the floor; then 1 to kErrors.size().
std::size_t level_of(double error_n, double floor_n) {
  if (!(error_n > floor_n)) return 0;
  std::size_t level = 1;
  for (double limit = kLevelFactor * floor_n; error_n > limit && level < kErrors.size();
       limit *= kLevelFactor)
    ++level;
  return level;
}

/// Errors of one renderer along the path.
std::string errors(const Study& study, std::size_t renderer, const ModelView& view) {
  const metrics::AccuracyFrames& f = study.runs[renderer].per_frame;
  std::string svg;
  const double floor = floor_of(study);
  for (std::size_t level = 1; level <= kErrors.size() && !f.force_error_n.empty(); ++level)
    svg += stroke(pieces(study, view,
                         [&](std::size_t i) {
                           return level_of(static_cast<double>(f.force_error_n[i]), floor) == level;
                         }),
                  kErrors[level - 1]);
  svg += stroke(pieces(study, view, [&](std::size_t i) { return f.false_contact[i] != 0; }), kFalse);
  svg += stroke(pieces(study, view, [&](std::size_t i) { return f.missed_contact[i] != 0; }), kMissed);
  return svg;
}

/// Renderers with scores frame by frame.
std::vector<std::size_t> scored(const Study& study) {
  std::vector<std::size_t> some;
  for (std::size_t i = 0; i < study.runs.size(); ++i)
    if (!study.runs[i].per_frame.missed_contact.empty()) some.push_back(i);
  return some;
}

bool any_forces(const Study& study) {
  return std::any_of(study.runs.begin(), study.runs.end(),
                     [](const StudyRun& run) { return !run.per_frame.force_error_n.empty(); });
}

struct Entry {
  std::string text;
  Level level;
};
std::vector<Entry> legend_of(const Study& study) {
  std::vector<Entry> entries;
  if (any_forces(study)) {
    double limit = floor_of(study);
    for (std::size_t i = 0; i < kErrors.size(); ++i) {
      const bool last = i + 1 == kErrors.size();
      entries.push_back(
          {last ? fmt::format("over {} N", format_number(limit))
                : fmt::format("{} to {} N", format_number(limit), format_number(kLevelFactor * limit)),
           kErrors[i]});
      limit *= kLevelFactor;
    }
  }
  entries.push_back({"contact missed", kMissed});
  entries.push_back({"false contact", kFalse});
  return entries;
}

std::string legend_svg(const Study& study, int y) {
  constexpr int kSample = 26, kLetter = 8, kRoom = 22;
  std::string svg;
  int x = kModelGap;
  for (const Entry& entry : legend_of(study)) {
    svg += fmt::format(
        "<line x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" stroke=\"{}\" stroke-width=\"{}\"/><text x=\"{}\" "
        "y=\"{}\">{}</text>",
        x, y - 4, x + kSample, y - 4, entry.level.colour, entry.level.width + 1.0,
        x + kSample + kModelGap / 2, y, html_escaped(entry.text));
    x += kSample + kRoom + kLetter * static_cast<int>(text_width(entry.text));
  }
  return svg;
}

struct Panel {
  std::string title, lines;
};

/// Parts that all of them share: the shaded models and the thin path.
std::string shared_parts(const Study& study, const ModelView& view, const std::string& id) {
  geometry::Aabb box = box_of(study);
  const ModelView fine(box, kImagePerUnit * view.width(), kImagePerUnit * view.height());
  return fmt::format(
      "<defs><g id=\"{0}\"><image width=\"{1}\" height=\"{2}\" preserveAspectRatio=\"none\" "
      "href=\"data:image/png;base64,{3}\"/><path d=\"{4}\" stroke=\"#0072b2\" stroke-width=\"1.1\" "
      "stroke-opacity=\"0.75\"/></g></defs>",
      id, view.width(), view.height(), base64(png_of(draw_models(study.models, fine))),
      whole_path(study, view));
}

std::string svg_of(const Study& study, const std::vector<Panel>& panels, const ModelView& view,
                   const std::string& name) {
  const int columns = std::min<int>(static_cast<int>(panels.size()), kMostColumns);
  const int rows = (static_cast<int>(panels.size()) + columns - 1) / columns;
  const int width = columns * (view.width() + kModelGap) + kModelGap;
  const int row_height = view.height() + kTitleHeight + kModelGap;
  const bool legend = panels.size() > 1;
  const int height = rows * row_height + (legend ? kLegendHeight : 0) + kModelGap;
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" height=\"{1}\" "
      "font-family=\"Helvetica,Arial,sans-serif\" font-size=\"14\" fill=\"#222222\"><rect width=\"{0}\" "
      "height=\"{1}\" fill=\"#ffffff\"/>{2}",
      width, height, shared_parts(study, view, name + "-model"));
  if (legend) svg += legend_svg(study, kLegendHeight - kModelGap / 2);
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const int column = static_cast<int>(i) % columns, row = static_cast<int>(i) / columns;
    const int x = kModelGap + column * (view.width() + kModelGap),
              y = (legend ? kLegendHeight : 0) + kModelGap + row * row_height;
    svg += fmt::format(
        "<g transform=\"translate({} {})\"><text x=\"0\" y=\"14\">{}</text><g transform=\"translate(0 {})\" "
        "fill=\"none\" stroke-linejoin=\"round\" stroke-linecap=\"round\"><use "
        "href=\"#{}-model\"/>{}</g></g>",
        x, y, html_escaped(panels[i].title), kTitleHeight, name, panels[i].lines);
  }
  return svg + "</svg>\n";
}

std::string models_text(const Study& study) {
  std::string names;
  for (const metrics::StudyModel& model : study.document.models)
    names +=
        fmt::format("{}{}, {} points", names.empty() ? "" : "; ", model.name, format_count(model.points));
  return names;
}

}  // namespace

Figure model_figure(const Study& study, const std::string& prefix) {
  Figure figure;
  figure.name = prefix + "-model";
  figure.title = study.document.models.size() > 1 ? "The models, and the path over them"
                                                  : "The model, and the path over it";
  figure.wide = true;
  const geometry::Aabb box = box_of(study);
  if (box.empty()) {
    figure.caption = "The study holds no sample of a model.";
    return figure;
  }
  const std::vector<std::size_t> renderers = scored(study);
  const bool alone = renderers.empty();
  const ModelView view(box, alone ? kAloneWidth : kPanelWidth, alone ? kAloneHeight : kModelPanelHeight);
  std::vector<Panel> panels = {{alone ? "" : "path", ""}};
  for (const std::size_t i : renderers)
    panels.push_back({study.document.renderers[i].label, errors(study, i, view)});
  figure.svg = svg_of(study, panels, view, figure.name);
  figure.caption = fmt::format(
      "{}, as {} stand at the start; at most {} points of each are drawn. Blue: the path of the HIP.{}",
      models_text(study), study.document.models.size() > 1 ? "they" : "its points",
      format_count(kSamplePoints),
      alone ? " There is no ground truth, so no error to show."
      : any_forces(study)
          ? " In colour: the force error, where it is more than a device can show; and contact that is wrong "
            "by more than one local resolution."
          : " In colour: contact that is wrong by more than one local resolution; forces are not compared.");
  return figure;
}

}  // namespace palpate::experiments
