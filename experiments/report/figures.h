// Figures of a study: gnuplot draws them as SVG; the script and its data stay beside the picture.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/vec.h>
#include "experiments/study/study.h"

namespace palpate::experiments {

struct Figure {
  std::string name;  ///< of its files: NAME.gp, NAME.dat, NAME.svg
  std::string title;
  std::string caption;
  std::string svg;    ///< to be put into a page; empty where gnuplot failed
  bool wide = false;  ///< takes the whole width
};

/// Style of a line.
struct LineStyle {
  std::string colour;
  std::string dash;  ///< of gnuplot's `dt`; empty: solid
};
/// One style for each label, no two alike while there are enough: colours that the colour-blind tell apart
/// (Okabe and Ito's palette and a few more), then the same in dashes. A renderer's name has the same one in
/// every figure; any other label gets what the fewest share there, whatever the order: first its colour and
/// dashes, then its colour. The truth is grey and not among them.
[[nodiscard]] std::vector<LineStyle> line_styles_of(const std::vector<std::string>& labels);

/// One line of a chart.
struct Series {
  std::string label;
  std::string colour;
  std::vector<double> x, y;  ///< a y that is not finite interrupts the line
  std::string dash{};        ///< as in LineStyle
  bool is_truth = false;     ///< drawn wide, behind the others
  /// Of kMarks: the ends of x and of y of each point, drawn as thin bars; a series without is a line of steps
  /// that has no name in the legend.
  struct Bars {
    double x_low, x_high, y_low, y_high;
  };
  std::vector<Bars> bars{};
};

/// Description of a chart for gnuplot.
struct Chart {
  std::string name, title, caption;
  std::string x_label, y_label;
  bool log_x = false, log_y = false;
  enum class Style {
    kLines,
    kSteps,
    kMarkedLines,
    kBars,   ///< lying: x is the length from `bars_from`, y the row
    kMarks,  ///< points with their intervals
    kPanels  ///< one panel for each series, the first one (the truth) behind it in all
  };
  Style style = Style::kLines;
  double bars_from = 0.0;
  int height = 0;  ///< in the units of the SVG; 0: as usual
  bool wide = false;
  std::string extra;                                  ///< gnuplot commands before `plot`
  std::string nothing = "There is nothing to draw.";  ///< said where no series has a point
  std::vector<Series> series;
};

/// Whether any series has a point to draw.
[[nodiscard]] bool has_points(const Chart& chart);

/// Writes data and script into `folder` and runs gnuplot there. Failing leaves Figure::svg empty and says why
/// in the caption: a report without one picture is better than none.
[[nodiscard]] Figure draw(const Chart& chart, const OutputFolder& folder);

/// The same figure, its script run again; an empty Figure::svg and a caption that says why where that fails.
[[nodiscard]] Figure drawn_again(Figure figure, const OutputFolder& folder);

/// All figures of a study; `prefix` begins their names.
[[nodiscard]] std::vector<Figure> draw_study(const Study& study, const std::string& prefix,
                                             const OutputFolder& folder);

// Pictures as PNG, to be put into a page or a file.

/// Rows from the top, a byte a pixel: 0 black, 255 white.
struct GreyImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;
};

/// Rows from the top, three bytes a pixel: red, green, blue.
struct ColourImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;

  [[nodiscard]] const std::uint8_t* at(int x, int y) const noexcept {
    constexpr std::size_t kBytes = 3;
    return &rgb[kBytes * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                          static_cast<std::size_t>(x))];
  }
};

/// The bytes of a PNG file (ISO/IEC 15948), 8 bits grey; empty where the image is.
[[nodiscard]] std::string png_of(const GreyImage& image);
/// 8 bits a colour, packed quickly: a window writes one between two frames.
[[nodiscard]] std::string colour_png(const ColourImage& image);

/// RFC 4648, with padding.
[[nodiscard]] std::string base64(const std::string& bytes);

// Picture of a model: its points as shaded discs, seen from above and from one side.

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
