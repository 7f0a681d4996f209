// The plug-in of OpenNI2's cameras, without one: it loads, and says why there is no camera.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <memory>
#include <string>

#include <palpate/depth_stream.h>
#include "toolkit/stream/depth_source.h"

namespace palpate::stream {
namespace {

using Open = DepthSource* (*)(const char* name, char* error, std::size_t size);

/// The plug-in's opener; it stays loaded, as in a program.
Open entry() {
  void* const module = ::dlopen(PALPATE_OPENNI_MODULE, RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(module, nullptr) << ::dlerror();
  if (module == nullptr) return nullptr;
  const auto plugin = reinterpret_cast<const OpenNiPlugin* (*)()>(::dlsym(module, kOpenNiEntry));
  EXPECT_NE(plugin, nullptr);
  if (plugin == nullptr) return nullptr;
  EXPECT_EQ(plugin()->abi, kOpenNiAbi);
  EXPECT_GE(plugin()->size, sizeof(OpenNiPlugin));
  return plugin()->open;
}

std::string refusal(const char* name) {
  const Open open = entry();
  if (open == nullptr) return {};
  std::array<char, 256> error{};
  const std::unique_ptr<DepthSource> source(open(name, error.data(), error.size()));
  EXPECT_EQ(source, nullptr);
  return error.data();
}

TEST(OpenNiPlugin, SaysWhyThereIsNoCamera) {
  ASSERT_NE(entry(), nullptr);
  EXPECT_NE(refusal("openni:99").find("camera"), std::string::npos);
  EXPECT_NE(refusal("openni:/nowhere.oni").find("/nowhere.oni"), std::string::npos);
  for (const char* name : {"openni:", "kinect", ""})
    EXPECT_NE(refusal(name).find("no name of a camera"), std::string::npos) << name;
}

TEST(OpenNiPlugin, AMessageFitsItsRoom) {
  const Open open = entry();
  ASSERT_NE(open, nullptr);
  std::array<char, 9> error;
  error.fill('x');
  EXPECT_EQ(open("kinect", error.data(), error.size() - 1), nullptr);
  EXPECT_EQ(std::strlen(error.data()), error.size() - 2);
  EXPECT_EQ(error.back(), 'x');
}

/// OpenNI's own dummy sends images but tells no field of view, without which no pixel has a place.
TEST(OpenNiPlugin, ACameraWithoutAFieldOfViewIsRefused) {
  const std::string why = refusal("openni:Dummy");
  if (why.find("Couldn't open") != std::string::npos)
    GTEST_SKIP() << "OpenNI's dummy driver is not installed: " << why;
  EXPECT_EQ(why, "it does not tell its field of view");
}

}  // namespace
}  // namespace palpate::stream
