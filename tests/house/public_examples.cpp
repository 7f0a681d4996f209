// What the public headers show first, compiled: no source root is on the include path here, so nothing inside
// leaks. public_examples.cmake takes the examples from the headers.
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "public_headers.inc"

namespace palpate::example {

// What examples speak of without making it: an application has it.
int failed(const Error& error);
Result<double> half_of(double x);
Status prepare_all();
struct FakeThread {
  const device::LoopHistograms& histograms() const;
};
struct Fresh {
  bool zero() const;
};
void save();
void send(const Vec3& force_n);
void take(std::uint8_t byte);
bool going_on();
double next_tick_s();
extern cloud::Cloud cloud;
extern render::HapticRenderer* renderer;
extern std::unique_ptr<render::HapticRenderer> inner;
extern render::Registry registry;
extern io::Readers readers;
extern trace::ProbePath path;
extern trace::ReplayReport replayed;
extern trace::ReferenceTrace truth;
extern metrics::Accuracy accuracy;
extern render::Frame frame;
extern Vec3 hip_mm, free_mm, target_mm;
extern MonotonicClock clock;
extern VirtualClock virtual_clock;
extern device::DeviceState state;
extern device::Servo& servo;
extern device::Link& link;
extern FakeThread thread;
extern Fresh fresh;
extern render::SceneInput& scene;
extern device::Device& device;

// An example ends where its value is there, and names its own as the application's.
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-variable"
#pragma GCC diagnostic ignored "-Wunused-but-set-variable"
#include "public_examples.inc"

}  // namespace palpate::example
