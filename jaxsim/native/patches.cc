// For every patch of an image the patches around it that look most alike.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tasks.h"

namespace {

constexpr int64_t kLines = 8;  // of patches, that a task answers: their distances at a shift stay in the first cache

// Sums over the P x P cells, d apart, of every patch of `lines`; line(row, to) writes the cells of a row.
template <int P, typename Line>
void BoxSums(int64_t lines, int64_t columns, int64_t d, std::vector<float>& work, Line line, float* out) {
  const int64_t rows = lines + d * (P - 1), wide = columns + d * (P - 1);
  work.resize((rows + 1) * wide);
  float* const sums = work.data() + rows * wide;
  for (int64_t row = 0; row < rows; ++row) line(row, work.data() + row * wide);
  for (int64_t row = 0; row < lines; ++row) {
    const float* const cells = work.data() + row * wide;
    // The first cell comes last, as in XLA's form.
#pragma GCC ivdep
    for (int64_t j = 0; j < wide; ++j) {
      float sum = cells[d * wide + j];
#pragma GCC unroll 8
      for (int i = 2; i < P; ++i) sum += cells[d * i * wide + j];
      sums[j] = sum + cells[j];
    }
    float* const to = out + row * columns;
#pragma GCC ivdep
    for (int64_t j = 0; j < columns; ++j) {
      float sum = sums[j + d];
#pragma GCC unroll 8
      for (int i = 2; i < P; ++i) sum += sums[j + d * i];
      to[j] = sum + sums[j];
    }
  }
}

// The nearest of a patch, ascending; of equals the one that came first stands first.
struct Nearest {
  float* distance;
  int32_t* shift;
  int64_t count;

  void Add(float far, int32_t at) {
    int64_t k = count - 1;
    for (; k > 0 && far < distance[k - 1]; --k) {
      distance[k] = distance[k - 1];
      shift[k] = shift[k - 1];
    }
    distance[k] = far;
    shift[k] = at;
  }
};

// Arrays of an image: what is asked, and what is answered.
struct Search {
  const float *image, *mask;  // mask: null where every cell is measured
  int64_t width, rows, columns, p, d, radius, count;
  float unlike;
  float* nearest;
  int32_t* number;

  int64_t Wide() const { return columns + d * (p - 1); }
  const float* Here(const float* of, int64_t row) const { return of + (row + radius * d) * width + radius * d; }
  const float* There(const float* of, int64_t row, int64_t shift) const {
    const int64_t side = 2 * radius + 1;
    return of + (row + d * (shift / side)) * width + d * (shift % side);
  }
};

// Distances of `lines` lines of patches from `first` on to those that lie at this shift.
template <int P>
void Distances(const Search& of, int64_t first, int64_t lines, int64_t shift, std::vector<float>& work,
               std::vector<float>& shared, float* far) {
  const int64_t wide = of.Wide(), n = lines * of.columns;
  if (!of.mask) {
    BoxSums<P>(lines, of.columns, of.d, work, [&](int64_t row, float* to) {
      const float *a = of.There(of.image, first + row, shift), *b = of.Here(of.image, first + row);
#pragma GCC ivdep
      for (int64_t j = 0; j < wide; ++j) to[j] = (a[j] - b[j]) * (a[j] - b[j]);
    }, far);
    return;
  }
  // Each side times the other's mask: cells that only one measured are equal, and add nothing.
  BoxSums<P>(lines, of.columns, of.d, work, [&](int64_t row, float* to) {
    const float *a = of.There(of.image, first + row, shift), *b = of.Here(of.image, first + row);
    const float *ma = of.There(of.mask, first + row, shift), *mb = of.Here(of.mask, first + row);
#pragma GCC ivdep
    for (int64_t j = 0; j < wide; ++j) {
      const float off = a[j] * mb[j] - b[j] * ma[j];
      to[j] = off * off;
    }
  }, far);
  BoxSums<P>(lines, of.columns, of.d, work, [&](int64_t row, float* to) {
    const float *ma = of.There(of.mask, first + row, shift), *mb = of.Here(of.mask, first + row);
#pragma GCC ivdep
    for (int64_t j = 0; j < wide; ++j) to[j] = ma[j] * mb[j];
  }, shared.data());
  const float* const met = shared.data();
#pragma GCC ivdep
  for (int64_t k = 0; k < n; ++k) {
    const float scaled = far[k] * (static_cast<float>(P * P) / std::max(met[k], 1.0f));
    far[k] = met[k] >= static_cast<float>(P) ? scaled : of.unlike;
  }
}

// The nearest of `lines` lines of patches, from `first` on.
template <int P>
void Answer(const Search& of, int64_t first, int64_t lines) {
  const int64_t n = lines * of.columns, side = 2 * of.radius + 1, middle = side * of.radius + of.radius;
  static thread_local std::vector<float> work, shared, distances, farthest;
  shared.resize(n);
  distances.resize(n);
  farthest.assign(n, HUGE_VALF);
  float *const far = distances.data(), *const last = farthest.data();
  float* const nearest = of.nearest + first * of.columns * of.count;
  int32_t* const shifts = of.number + first * of.columns * of.count;
  std::fill(nearest, nearest + n * of.count, HUGE_VALF);
  for (int64_t k = 0; k < n; ++k) {  // the patch itself comes first, whatever else is as near
    nearest[k * of.count] = 0;
    shifts[k * of.count] = static_cast<int32_t>(middle);
  }
  for (int64_t shift = 0; shift < side * side; ++shift) {
    if (shift == middle) continue;
    Distances<P>(of, first, lines, shift, work, shared, far);
    constexpr int64_t kStep = 16;  // most patches are far from most shifts: ask many at once
    for (int64_t k = 0; k < n; k += kStep) {
      const int64_t end = std::min(k + kStep, n);
      int any = 0;
      for (int64_t j = k; j < end; ++j) any |= far[j] < last[j];
      if (!any) continue;
      for (int64_t j = k; j < end; ++j) {
        if (!(far[j] < last[j])) continue;
        Nearest{nearest + j * of.count + 1, shifts + j * of.count + 1, of.count - 1}.Add(
            far[j], static_cast<int32_t>(shift));
        last[j] = nearest[j * of.count + of.count - 1];
      }
    }
  }
  for (int64_t k = 0; k < n * of.count; ++k) {  // a shift's patch, by its number in the image
    const int64_t row = first + k / of.count / of.columns, column = k / of.count % of.columns;
    const int64_t down = row + of.d * (shifts[k] / side), across = column + of.d * (shifts[k] % side);
    shifts[k] = static_cast<int32_t>(down * (of.width - of.d * (P - 1)) + across);
  }
}

// image, mask (*b, h, w), with a margin of radius * d cells -> distance, number (*b, rows, columns, count)
ffi::Error NearestPatches(ffi::ThreadPool pool, Floats image, Floats mask, int64_t p, int64_t d, int64_t radius,
                          float unlike, ffi::ResultBuffer<ffi::F32> distance, ffi::ResultBuffer<ffi::S32> number) {
  if (p != 5 && p != 7) return ffi::Error::InvalidArgument("patches are 5 or 7 cells wide");
  const auto shape = image.dimensions(), result = distance->dimensions();
  const int64_t cells = Last(shape, 2) * Last(shape, 1), rows = Last(result, 3);
  const int64_t each = rows * Last(result, 2) * Last(result, 1), blocks = (rows + kLines - 1) / kLines;
  const bool masked = mask.element_count() == image.element_count();  // one number where every cell is measured
  Parallel(pool, Batch(shape, 2) * blocks, [&](int64_t task) {
    const int64_t sample = task / blocks, first = task % blocks * kLines;
    const Search of{image.typed_data() + sample * cells, masked ? mask.typed_data() + sample * cells : nullptr,
                    Last(shape, 1), rows, Last(result, 2), p, d, radius, Last(result, 1), unlike,
                    distance->typed_data() + sample * each, number->typed_data() + sample * each};
    (p == 5 ? Answer<5> : Answer<7>)(of, first, std::min(kLines, rows - first));
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_nearest_patches, NearestPatches,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Floats>()
                                  .Arg<Floats>()
                                  .Attr<int64_t>("p")
                                  .Attr<int64_t>("d")
                                  .Attr<int64_t>("radius")
                                  .Attr<float>("unlike")
                                  .Ret<Floats>()
                                  .Ret<Integers>());
