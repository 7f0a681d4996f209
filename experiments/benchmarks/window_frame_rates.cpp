// Picture rate of the window and time to a complete picture, for several cloud sizes, with the camera turning
// and still. Needs a display, such as xvfb-run.
//
//   window_frame_rates [KEY=VALUE ...]     points=400000,1000000,3600000 seconds=3
//   window_frame_rates jitter=60           servo lateness with and without drawing instead, 60 s of each in
//                                          slices; points: the first number
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/generate.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include "experiments/benchmarks/window_jitter.h"
#include "experiments/window/window.h"
#include "toolkit/core/message_text.h"

namespace {

using namespace palpate;
using namespace palpate::experiments;

constexpr double kTurnRad = 0.02;  // per picture
constexpr double kMsPerSecond = 1e3;

struct Rate {
  std::size_t points = 0;
  double turning = 0.0, standing = 0.0;  // pictures a second
  std::size_t points_a_picture = 0;      // while turning
  double whole_s = 0.0;                  // from the camera's stop until all points are drawn
  std::size_t whole_pictures = 0;        // number of pictures until then
};

Result<std::shared_ptr<const ShownScene>> scene_of(std::size_t points) {
  PALPATE_ASSIGN(NamedOptions wanted, parse_named_options(fmt::format("sinusoid:points={}", points)));
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(wanted));
  render::ModelInput model;
  model.name = wanted.name;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  return std::make_shared<const ShownScene>(ShownScene{wanted.name, {model}});
}

/// Pictures a second over `seconds`; calls `before` before each.
template <class Before>
double rate_of(Window& window, double seconds, Before&& before) {
  const Stopwatch watch;
  int pictures = 0;
  while (watch.ms() < kMsPerSecond * seconds) {
    before();
    window.frame();
    ++pictures;
  }
  return kMsPerSecond * pictures / watch.ms();
}

Rate measured(Window& window, std::size_t points, double seconds) {
  Rate rate;
  rate.points = points;
  const SplatDrawer& splats = window.scene().splats();
  // Waits for normals, which affect drawing.
  while (*window.scene().awaited() != '\0') window.frame();
  const auto turn = [&] {
    Camera camera = window.camera();
    camera.turn(kTurnRad, 0.0);
    window.look_from(camera);
  };
  (void)rate_of(window, 0.5 * seconds, turn);  // settles the budget
  rate.turning = rate_of(window, seconds, turn);
  rate.points_a_picture = splats.points_a_frame();
  turn();
  const Stopwatch watch;
  while (splats.drawn() < splats.points() || splats.drawn() == 0) window.frame();
  rate.whole_s = watch.ms() / kMsPerSecond;
  rate.whole_pictures = splats.whole_after();
  rate.standing = rate_of(window, seconds, [] {});
  return rate;
}

Status run(const Options& options) {
  constexpr NumberRange kSeconds{0.1, 3600.0};
  PALPATE_ASSIGN(const double seconds, read_number(options.text("seconds"), kSeconds));
  if (!options.text("jitter").empty()) {
    constexpr NumberRange kJitterS{0.1, 86'400.0};
    JitterWanted jitter;
    PALPATE_ASSIGN(jitter.seconds, read_number(options.text("jitter"), kJitterS));
    jitter.slice_s = std::min(jitter.slice_s, jitter.seconds);
    PALPATE_ASSIGN(const double points,
                   read_number(split_list(options.text("points")).front(), NumberRange{1.0, 1e9, true}));
    jitter.points = static_cast<std::size_t>(points);
    return measure_jitter(jitter);
  }
  SessionLink link;
  WindowOptions wanted;
  wanted.paced = false;
  PALPATE_ASSIGN(const std::unique_ptr<Window> window, Window::open(link, wanted));
  fmt::print(
      "drawn by {}\n\n| points | pictures/s turning | points in each | whole after, s | in pictures | "
      "pictures/s standing |\n"
      "| ---: | ---: | ---: | ---: | ---: | ---: |\n",
      window->graphics());
  for (const std::string& text : split_list(options.text("points"))) {
    const Result<double> points = read_number(text, NumberRange{1.0, 1e9, true});
    if (!points) return points.error();
    PALPATE_ASSIGN(std::shared_ptr<const ShownScene> scene, scene_of(static_cast<std::size_t>(*points)));
    link.show(scene);
    window->frame();
    const Rate rate = measured(*window, scene->models.front().cloud->size(), seconds);
    fmt::print("| {} | {:.1f} | {} | {:.2f} | {} | {:.1f} |\n", rate.points, rate.turning,
               rate.points_a_picture, rate.whole_s, rate.whole_pictures, rate.standing);
    std::fflush(stdout);  // the largest takes a while
  }
  return Done{};
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  options.set("points", "400000,1000000,3600000");
  options.set("seconds", "3");
  options.set("jitter", "");
  for (int i = 1; i < argc; ++i) {
    const std::vector<std::string> word = split_list(argv[i], '=');
    if (word.size() != 2 || !options.all().contains(word[0])) {
      fmt::print(stderr,
                 "window_frame_rates: {} is not understood; give points=N,.., seconds=S or jitter=S\n",
                 argv[i]);
      return 2;
    }
    options.set(word[0], word[1]);
  }
  const Status done = run(options);
  if (done) return 0;
  fmt::print(stderr, "window_frame_rates: {}\n", done.error().message());
  return 1;
}
