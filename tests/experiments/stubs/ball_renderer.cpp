// An example of a renderer plug-in: a spring towards the sphere around the points' middle. It links nothing
// of Palpate. "options=fail" and "options=crash" show what becomes of a plug-in that does not work.
#include <palpate/renderer_plugin.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace {

struct Ball {
  double centre_mm[3] = {0.0, 0.0, 0.0};
  double radius_mm = 0.0;  ///< mean distance of the points
  double stiffness_n_per_mm = 0.0;
  bool fails = false, crashes = false;
};

void say(const char* words, char* text, std::uint32_t size) {
  std::strncpy(text, words, size - 1);
  text[size - 1] = '\0';
}

void* create(const char* options, char* text, std::uint32_t size) {
  const bool fails = std::strcmp(options, "fail") == 0, crashes = std::strcmp(options, "crash") == 0;
  if (*options != '\0' && !fails && !crashes) {
    say("its options are fail or crash", text, size);
    return nullptr;
  }
  Ball* const ball = new Ball;
  ball->fails = fails;
  ball->crashes = crashes;
  return ball;
}

std::int32_t prepare(void* renderer, const palpate_renderer_model* model, std::uint64_t* bytes, char* text,
                     std::uint32_t size) {
  Ball& ball = *static_cast<Ball*>(renderer);
  if (ball.crashes) std::abort();
  if (ball.fails) {
    say("it fails as asked", text, size);
    return 1;
  }
  const double n = static_cast<double>(model->points);
  for (std::uint64_t i = 0; i < 3 * model->points; ++i) ball.centre_mm[i % 3] += model->points_mm[i] / n;
  for (std::uint64_t i = 0; i < model->points; ++i) {
    const double* const p = model->points_mm + 3 * i;
    ball.radius_mm +=
        std::hypot(p[0] - ball.centre_mm[0], p[1] - ball.centre_mm[1], p[2] - ball.centre_mm[2]) / n;
  }
  ball.stiffness_n_per_mm = model->stiffness_n_per_mm;
  *bytes = sizeof(Ball);
  return 0;
}

void restart(void*, const double*, double) {}

void step(void* renderer, const double* hip_mm, double, palpate_renderer_frame* frame) {
  const Ball& ball = *static_cast<const Ball*>(renderer);
  double out[3], distance = 0.0;
  for (int k = 0; k < 3; ++k) {
    out[k] = hip_mm[k] - ball.centre_mm[k];
    distance += out[k] * out[k];
  }
  distance = std::sqrt(distance);
  frame->contact = distance > 0.0 && distance < ball.radius_mm ? 1 : 0;
  if (frame->contact == 0) return;
  for (int k = 0; k < 3; ++k) {
    frame->god_object_mm[k] = ball.centre_mm[k] + out[k] / distance * ball.radius_mm;
    frame->force_n[k] = ball.stiffness_n_per_mm * (frame->god_object_mm[k] - hip_mm[k]);
  }
}

void destroy(void* renderer) {
  delete static_cast<Ball*>(renderer);
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const palpate_renderer_plugin* palpate_renderer_entry() {
  static const palpate_renderer_plugin plugin = {PALPATE_RENDERER_ABI,
                                                 sizeof(palpate_renderer_plugin),
                                                 "a sphere around the points' middle",
                                                 create,
                                                 prepare,
                                                 restart,
                                                 step,
                                                 destroy};
  return &plugin;
}
