// C interface of a renderer plug-in: the library renderer-NAME.so in a folder of $PALPATE_PLUGINS, whose
// renderer every command knows as NAME. Plain C, for any language, compiler and licence; nothing of Palpate
// is linked.
//
// Units: mm, N, s, N/mm; world frame. Functions are called in this order, by one thread: create, prepare,
// then restart and any number of steps, again and again; destroy. None throws. Texts are UTF-8,
// zero-terminated, cut to size.
//
// First:
//   static palpate_renderer_plugin plugin;
//   plugin.abi = PALPATE_RENDERER_ABI;
//   plugin.size = sizeof(plugin);
//   plugin.what = "my renderer, and where it comes from";
//   plugin.step = [](void*, const double*, double, palpate_renderer_frame*) {};  // the others alike
#pragma once

#include <stdint.h>  // NOLINT: C

#ifdef __cplusplus
extern "C" {
#endif

/// Increases when anything below changes its meaning; other plug-ins are not used.
#define PALPATE_RENDERER_ABI 1u
/// The one symbol that a plug-in exports.
#define PALPATE_RENDERER_ENTRY "palpate_renderer_entry"

/// One rigid model at rest without friction. Arrays are valid until prepare returns.
typedef struct palpate_renderer_model {  // NOLINT: C
  const double* points_mm;               ///< x, y, z of each point
  uint64_t points;
  const double* vertices_mm;  ///< of the faces that belong to the points; null: there are none
  uint64_t vertices;
  const uint32_t* triangles;  ///< three vertices each, counter-clockwise from outside
  uint64_t triangle_count;
  double stiffness_n_per_mm;
  double force_limit_n;  ///< 0: none; Palpate itself applies it
  uint32_t threads;      ///< that prepare may use, at least 1
  uint32_t reserved;
} palpate_renderer_model;

typedef struct palpate_renderer_frame {  // NOLINT: C
  double force_n[3];                     ///< on the device; zero when free
  double god_object_mm[3];               ///< the HIP when free
  uint32_t contact;                      ///< 1: in contact
  uint32_t reserved;
} palpate_renderer_frame;

typedef struct palpate_renderer_plugin {  // NOLINT: C
  uint32_t abi;                           ///< PALPATE_RENDERER_ABI
  uint32_t size;                          ///< of this struct
  const char* what;                       ///< a line for people: the algorithm and its source

  /// `options`: as given in NAME:options=TEXT, else empty. Null: `text` says why not.
  void* (*create)(const char* options, char* text, uint32_t size);
  /// Builds all that a step needs. The call may allocate, use threads and take long. `bytes`: what it holds
  /// afterwards. 0: success; else `text` says why not.
  int32_t (*prepare)(void* renderer, const palpate_renderer_model* model, uint64_t* bytes, char* text,
                     uint32_t size);
  /// The HIP is free at this place and time; contact is forgotten.
  void (*restart)(void* renderer, const double hip_mm[3], double t_s);
  /// One haptic frame. Allocates, locks and prints nothing.
  void (*step)(void* renderer, const double hip_mm[3], double t_s, palpate_renderer_frame* frame);
  void (*destroy)(void* renderer);
} palpate_renderer_plugin;

/// Type of PALPATE_RENDERER_ENTRY. The struct lives as long as the module.
typedef const palpate_renderer_plugin* (*palpate_renderer_entry_fn)(void);  // NOLINT: C

#ifdef __cplusplus
}
#endif
