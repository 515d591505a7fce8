// What the page needs of OpenCV, as plain functions of WebAssembly. build.sh compiles them together
// with the library, and web/port/image/opencv.js calls them. Each does what Python's cv2 does there.

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <wasm_simd128.h>

#include "plane.h"

using namespace cv;

// The library looks for its settings in the environment; there is none.
extern "C" char *getenv(const char *) { return nullptr; }

// Only functions that draw change colours, and nothing here draws; so that part is left out.
void cv::cvtColor(InputArray, OutputArray, int, int, AlgorithmHint) { abort(); }

// Memory for the arguments of one call, in bytes; what it held before is lost.
PAGE void *room(int bytes) {
  static Mat memory;
  if (memory.cols < bytes) memory.create(1, bytes, CV_8U);
  return memory.data;
}

// Bytes are blurred as floats, but as far as OpenCV blurs bytes.
PAGE void blurred(const Plane &from, double sigma, const Plane &to) {
  const int length = cvRound(sigma * (from.type == CV_8U ? 3 : 4) * 2 + 1) | 1;
  Mat floats = from.mat();
  if (from.type != CV_32F) floats.convertTo(floats, CV_32F);
  GaussianBlur(floats, to.mat(), Size(length, length), sigma);
}

static void takeMeanAround(const Mat &from, Size around, Mat &&to) {
  blur(from, to, around);
  subtract(from, to, to);
}

PAGE void lessMeanAround(const Plane &from, int across, int down, const Plane &to) {
  takeMeanAround(from.mat(), Size(across, down), to.mat());
}

// Measures by how much each block is brighter than its neighbourhood of 3 x 3 blocks in views, a row
// each, whose lines are so many pixels wide; writes a row of blocks for each.
PAGE void standingOut(const Plane &views, int width, int cols, const Plane &to) {
  Mat blocks;
  for (int view = 0; view < views.height; view++) {
    const Mat pixels = views.mat().row(view).reshape(1, views.width / width);
    resize(pixels, blocks, Size(cols, to.width / cols), 0, 0, INTER_AREA);
    takeMeanAround(blocks, Size(3, 3), to.mat().row(view).reshape(1, blocks.rows));
  }
}

// Draws blocks as rectangles, with nothing around them.
PAGE void drawnBlocks(const Plane &blocks, int left, int top, const Plane &to) {
  const Rect inner(left, top, to.width - 2 * left, to.height - 2 * top);
  to.mat() = 0;
  resize(blocks.mat(), to.mat()(inner), inner.size(), 0, 0, INTER_NEAREST);
}

// Adds up the products of two maps with themselves and with each other.
PAGE void agreement(const Plane &seen, const Plane &expected, const Plane &sums) {
  sums.numbers()[0] = expected.mat().dot(expected.mat());
  sums.numbers()[1] = expected.mat().dot(seen.mat());
  sums.numbers()[2] = seen.mat().dot(seen.mat());
}

// Number of powers of x and of y, as in pilots/motion.js.
static const int powers = 5;

// Sums up a map times powers of x and of y, which give the places of its columns and rows.
static void addMoments(const double *map, const Plane &x, const Plane &y, double *table) {
  for (int row = 0; row < y.width; row++, map += x.width) {
    double line[powers] = {};
    for (int col = 0; col < x.width; col++) {
      double weight = map[col];
      for (int power = 0; power < powers; power++, weight *= x.numbers()[col]) line[power] += weight;
    }
    double factor = 1;
    for (int power = 0; power < powers; power++, factor *= y.numbers()[row]) {
      for (int k = 0; k < powers; k++) table[power * powers + k] += factor * line[k];
    }
  }
}

// Sums up what seen changes, one map below the other, tell of a display's motion beside expected ones
// (pilots/motion.js). Rows of `sums` are moments: of the squared slopes along x, of the products of
// both slopes, of the squared slopes along y, and of the slopes along x and along y times what the
// expected change leaves; then of what `bending`, a further motion along x and along y, shares with
// motions along x and along y; last its own square and its product with what is left. Returns the
// power of what is left.
PAGE double motionSums(const Plane &seen, const Plane &expected, double amplitude,
                       const Plane *weight, const Plane &x, const Plane &y, double scaleX,
                       double scaleY, const Plane *bending, const Plane &sums) {
  if (sums.width != powers * powers) abort();
  const int width = x.width, height = y.width, pixels = width * height;
  std::vector<double> maps[7];
  for (auto &map : maps) map.resize(pixels);
  Mat across, down;
  double power = 0;
  for (int first = 0; first < seen.width * seen.height; first += pixels) {
    const float *now = static_cast<float *>(seen.data) + first;
    float *then = static_cast<float *>(expected.data) + first;
    Sobel(Mat(height, width, CV_32F, then), across, CV_32F, 1, 0);
    Sobel(Mat(height, width, CV_32F, then), down, CV_32F, 0, 1);
    for (int at = 0; at < pixels; at++) {
      const double share = weight ? static_cast<float *>(weight->data)[at] : 1;
      const double slopeX = scaleX * amplitude * across.ptr<float>()[at];
      const double slopeY = scaleY * amplitude * down.ptr<float>()[at];
      const double left = now[at] - amplitude * then[at];
      power += share * left * left;
      maps[0][at] += share * slopeX * slopeX;
      maps[1][at] += share * slopeX * slopeY;
      maps[2][at] += share * slopeY * slopeY;
      maps[3][at] += share * slopeX * left;
      maps[4][at] += share * slopeY * left;
    }
  }
  double *own = sums.numbers() + 7 * sums.width;
  std::fill(sums.numbers(), own + sums.width, 0.0);
  if (bending) {
    const float *bendX = static_cast<float *>(bending->data), *bendY = bendX + pixels;
    for (int at = 0; at < pixels; at++) {
      maps[5][at] = bendX[at] * maps[0][at] + bendY[at] * maps[1][at];
      maps[6][at] = bendX[at] * maps[1][at] + bendY[at] * maps[2][at];
      own[0] += bendX[at] * maps[5][at] + bendY[at] * maps[6][at];
      own[1] += bendX[at] * maps[3][at] + bendY[at] * maps[4][at];
    }
  }
  for (int map = 0; map < (bending ? 7 : 5); map++) {
    addMoments(maps[map].data(), x, y, sums.numbers() + map * sums.width);
  }
  return power;
}

// Only the first pixels of each row and column are used.
PAGE void resized(const Plane &from, int width, int height, const Plane &to) {
  Mat used = from.mat()(Rect(0, 0, width, height));
  if (from.type != to.type) used.convertTo(used, to.type);
  resize(used, to.mat(), Size(to.width, to.height), 0, 0, INTER_AREA);
}

// Interpolates between the four pixels around a place; beyond the border its last pixel counts.
template <typename From, typename To>
static void mixOne(const Mat &from, float x, float y, To *to) {
  const float right = from.cols - 1, bottom = from.rows - 1;
  const int nextX = from.cols > 1, nextY = from.rows > 1 ? from.cols : 0;
  // a comparison that fails for what is no number, too
  const float atX = std::min(x > 0 ? x : 0, right), atY = std::min(y > 0 ? y : 0, bottom);
  const int left = std::min(int(atX), std::max(from.cols - 2, 0));
  const int top = std::min(int(atY), std::max(from.rows - 2, 0));
  const From *at = reinterpret_cast<From *>(from.data) + top * from.cols + left;
  const float shareX = atX - left, shareY = atY - top;
  const float above = at[0] + (at[nextX] - at[0]) * shareX;
  const float below = at[nextY] + (at[nextY + nextX] - at[nextY]) * shareX;
  *to = above + (below - above) * shareY + (sizeof(To) == 1 ? 0.5f : 0);
}

// Four floats, or four whole numbers.
typedef float Floats __attribute__((vector_size(16)));
typedef int Wholes __attribute__((vector_size(16)));

// Loads the pixels at four places, and those to the right of them.
static void loadPairs(const uchar *from, Wholes at, Floats &left, Floats &right) {
  v128_t pairs = wasm_i32x4_const(0, 0, 0, 0);
  pairs = wasm_v128_load16_lane(from + at[0], pairs, 0);
  pairs = wasm_v128_load16_lane(from + at[1], pairs, 2);
  pairs = wasm_v128_load16_lane(from + at[2], pairs, 4);
  pairs = wasm_v128_load16_lane(from + at[3], pairs, 6);
  left = Floats(wasm_f32x4_convert_i32x4(wasm_v128_and(pairs, wasm_i32x4_const_splat(255))));
  right = Floats(wasm_f32x4_convert_i32x4(wasm_u32x4_shr(pairs, 8)));
}

static void loadPairs(const float *from, Wholes at, Floats &left, Floats &right) {
  v128_t one = wasm_v128_load64_zero(from + at[0]), two = wasm_v128_load64_zero(from + at[2]);
  one = wasm_v128_load64_lane(from + at[1], one, 1);
  two = wasm_v128_load64_lane(from + at[3], two, 1);
  left = Floats(wasm_i32x4_shuffle(one, two, 0, 2, 4, 6));
  right = Floats(wasm_i32x4_shuffle(one, two, 1, 3, 5, 7));
}

static void store(Floats values, float *to) { wasm_v128_store(to, v128_t(values)); }

static void store(Floats values, uchar *to) {
  const v128_t whole = wasm_i32x4_trunc_sat_f32x4(v128_t(values + 0.5f));
  const v128_t words = wasm_i16x8_narrow_i32x4(whole, whole);
  wasm_v128_store32_lane(to, wasm_u8x16_narrow_i16x8(words, words), 0);
}

// Clips four floats; what is no number becomes 0.
static Floats clipped(const float *values, float most) {
  const v128_t positive = wasm_f32x4_pmax(wasm_f32x4_const_splat(0), wasm_v128_load(values));
  return Floats(wasm_f32x4_pmin(positive, wasm_f32x4_splat(most)));
}

// Interpolates at each of some places, at four of them at once where an image is not too thin.
template <typename From, typename To>
static void mix(const Mat &from, const float *x, const float *y, int count, To *to) {
  const From *pixels = reinterpret_cast<From *>(from.data);
  const float right = from.cols - 1, bottom = from.rows - 1;
  const bool isThin = std::min(from.cols, from.rows) < 2;
  int i = 0;
  for (; !isThin && i + 4 <= count; i += 4) {
    const Floats atX = clipped(x + i, right), atY = clipped(y + i, bottom);
    const Wholes left = Wholes(wasm_i32x4_min(wasm_i32x4_trunc_sat_f32x4(v128_t(atX)),
                                              wasm_i32x4_splat(from.cols - 2)));
    const Wholes top = Wholes(wasm_i32x4_min(wasm_i32x4_trunc_sat_f32x4(v128_t(atY)),
                                             wasm_i32x4_splat(from.rows - 2)));
    const Wholes at = top * from.cols + left;
    const Floats shareX = atX - Floats(wasm_f32x4_convert_i32x4(v128_t(left)));
    const Floats shareY = atY - Floats(wasm_f32x4_convert_i32x4(v128_t(top)));
    Floats a, b, c, d;
    loadPairs(pixels, at, a, b);
    loadPairs(pixels + from.cols, at, c, d);
    const Floats above = a + (b - a) * shareX, below = c + (d - c) * shareX;
    store(above + (below - above) * shareY, to + i);
  }
  for (; i < count; i++) mixOne<From>(from, x[i], y[i], to + i);
}

static void sample(const Plane &from, const float *x, const float *y, int count, const Plane &to,
                   int start) {
  if (to.type == CV_8U) mix<uchar>(from.mat(), x, y, count, static_cast<uchar *>(to.data) + start);
  else if (from.type == CV_8U) mix<uchar>(from.mat(), x, y, count, static_cast<float *>(to.data) + start);
  else mix<float>(from.mat(), x, y, count, static_cast<float *>(to.data) + start);
}

// warpPerspective takes twice as long, since WebAssembly loads no pixels from many places at once.
PAGE void warped(const Plane &from, const Plane &H, const Plane &to) {
  const double *h = H.numbers();
  const float stepX = h[0], stepY = h[3], stepW = h[6];
  std::vector<float> x(to.width), y(to.width);
  for (int row = 0; row < to.height; row++) {
    const float x0 = h[1] * row + h[2], y0 = h[4] * row + h[5], w0 = h[7] * row + h[8];
    for (int col = 0; col < to.width; col++) {
      const float scale = 1 / (stepW * col + w0);
      x[col] = (stepX * col + x0) * scale;
      y[col] = (stepY * col + y0) * scale;
    }
    sample(from, x.data(), y.data(), to.width, to, row * to.width);
  }
}

PAGE void remapped(const Plane &from, const Plane &x, const Plane &y, const Plane &to) {
  sample(from, x.mat().ptr<float>(), y.mat().ptr<float>(), to.width * to.height, to, 0);
}

// Adds rows of floats, times weights, to sums.
static void addRows(const Plane &rows, const float *weights, float *__restrict sums) {
  const float *__restrict values = static_cast<float *>(rows.data);
  for (int i = 0; i < rows.height; i++, values += rows.width) {
    for (int k = 0; k < rows.width; k++) sums[k] += weights[i] * values[k];
  }
}

// Adds up rows of floats, times weights: a row of sums for each row of weights.
PAGE void weightedSums(const Plane &rows, const Plane &weights, const Plane &to) {
  to.mat() = 0;
  for (int row = 0; row < to.height; row++) {
    addRows(rows, static_cast<float *>(weights.data) + row * rows.height,
            static_cast<float *>(to.data) + row * to.width);
  }
}

// Divides what differs from its mean over time by its deviation and so much more: a row for each frame.
PAGE void overDeviation(const Plane &values, double more, const Plane &to) {
  const int count = values.width, frames = values.height;
  const float *from = static_cast<float *>(values.data);
  float *over = static_cast<float *>(to.data);
  std::vector<double> mean(count), scale(count);
  for (int at = 0; at < frames * count; at += count) {
    for (int i = 0; i < count; i++) mean[i] += from[at + i];
  }
  for (double &sum : mean) sum /= frames;
  for (int at = 0; at < frames * count; at += count) {
    for (int i = 0; i < count; i++) scale[i] += (from[at + i] - mean[i]) * (from[at + i] - mean[i]);
  }
  for (double &sum : scale) sum = 1 / (std::sqrt(sum / frames) + more);
  for (int at = 0; at < frames * count; at += count) {
    for (int i = 0; i < count; i++) over[at + i] = (from[at + i] - mean[i]) * scale[i];
  }
}

// Finds the share of the signs' power that amplitudes at each of some frequencies explain, in the best
// of some phase slopes (pilots/signal.js). Values have a row for each frame, and waves and the pilots'
// signed phases two rows each, for the real and the imaginary part. Amplitudes far beyond `limit` times
// the median of all pilots count alike.
PAGE void explainedShares(const Plane &values, double more, double limit, const Plane &waves,
                          const Plane &phases, const Plane &shares) {
#pragma clang fp reassociate(on)
  const int pilots = values.width;
  Mat series(values.height, pilots, CV_32F);
  overDeviation(values, more, {series.data, CV_32F, pilots, values.height});
  std::vector<double> real(pilots), imaginary(pilots), sizes(pilots);
  for (int line = 0; line < waves.height; line += 2) {
    const double *cosine = waves.numbers() + line * waves.width, *sine = cosine + waves.width;
    std::fill(real.begin(), real.end(), 0.0);
    std::fill(imaginary.begin(), imaginary.end(), 0.0);
    for (int t = 0; t < values.height; t++) {
      const float *now = series.ptr<float>(t);
      for (int p = 0; p < pilots; p++) {
        real[p] += cosine[t] * now[p];
        imaginary[p] += sine[t] * now[p];
      }
    }
    for (int p = 0; p < pilots; p++) sizes[p] = std::hypot(real[p], imaginary[p]);
    std::sort(sizes.begin(), sizes.end());
    const double usual = limit * (sizes[(pilots - 1) / 2] + sizes[pilots / 2]) / 2;
    for (int p = 0; p < pilots; p++) {
      const double squared = real[p] * real[p] + imaginary[p] * imaginary[p];
      const double bound = 1 / std::sqrt(squared + usual * usual + 1e-12);
      real[p] *= bound;
      imaginary[p] *= bound;
    }
    double &most = shares.numbers()[line / 2] = -1;
    for (int phase = 0; phase < phases.height; phase += 2) {
      const double *turn = phases.numbers() + phase * pilots, *across = turn + pilots;
      double a = 0, b = 0, rr = 0, ii = 0, ri = 0;
      for (int p = 0; p < pilots; p++) {
        const double r = real[p] * turn[p] - imaginary[p] * across[p];
        const double i = real[p] * across[p] + imaginary[p] * turn[p];
        a += r;
        b += i;
        rr += r * r;
        ii += i * i;
        ri += r * i;
      }
      const double power = (rr + ii) * (1 + 1e-9) + 1e-12, rest = (power - rr - ii) / 2;
      const double apart = std::max((rr + rest) * (ii + rest) - ri * ri, 1e-10 * power * power);
      const double explained = a * a * (ii + rest) - 2 * a * b * ri + b * b * (rr + rest);
      most = std::max(most, explained / apart / pilots);
    }
  }
}

// Adds up frames, a row of pixels each, times what each column shows in them, or each row: `shown` has a
// row for each of these.
PAGE void sumsAlong(const Plane &frames, const Plane &shown, int byRows, const Plane &to) {
  const float *from = static_cast<float *>(frames.data);
  std::fill_n(static_cast<float *>(to.data), to.width * to.height, 0.0f);
  for (int t = 0; t < frames.height; t++) {
    float *sum = static_cast<float *>(to.data);
    const double *share = shown.numbers() + t;
    for (int y = 0; y < to.height; y++) {
      for (int x = 0; x < to.width; x++) *sum++ += *from++ * share[(byRows ? y : x) * shown.width];
    }
  }
}

// Keeps in each column the largest of `weightedSums`, and 0 where none is positive.
PAGE void largestSums(const Plane &rows, const Plane &weights, const Plane &to) {
  Mat largest = to.mat(), sums(largest.size(), CV_32F);
  largest = 0;
  for (int row = 0; row < weights.height; row++) {
    sums = 0;
    addRows(rows, weights.mat().ptr<float>(row), sums.ptr<float>());
    max(largest, sums, largest);
  }
}

// Integrates, from 0 to x states, a wave that is 1 while an embedded frame is shown, else 0; a code's
// signs order the states of each frame pair.
static double onTime(double x, const Plane &signs) {
  const int pair = cvFloor(x * 0.5), at = pair % signs.width;
  const double rest = x - 2.0 * pair, sign = signs.numbers()[at < 0 ? at + signs.width : at];
  return pair + (sign < 0 ? std::min(rest, 1.0) : std::max(rest - 1, 0.0));
}

// Works out the share that embedded frames have of exposures at some times, of a place that sees the
// display's first state from `start` on.
static void expose(double period, double start, double shutter, const Plane &times,
                   const Plane &signs, double *shares) {
  const double faster = 1 / period, length = shutter / period, scale = period / shutter;
  for (int t = 0; t < times.width; t++) {
    const double begin = (times.numbers()[t] - start) * faster;
    shares[t] = (onTime(begin + length, signs) - onTime(begin, signs)) * scale;
  }
}

// The shares at each place of the display; a clock is that of web/port/link/clock.js.
PAGE void embeddedShare(const Plane &clock, const Plane &times, const Plane &places,
                        const Plane &signs, const Plane &to) {
  const double *numbers = clock.numbers(), *place = places.numbers();
  for (int p = 0; p < places.width / 2; p++, place += 2) {
    const double delay = numbers[2] * place[0] + numbers[3] * place[1];
    expose(numbers[0], numbers[1] - delay, numbers[4], times, signs, to.numbers() + p * times.width);
  }
}

// Makes what a block of sign 1 shows at a display's centre by each of its clocks, as pilots/code.js
// numbers them, less the mean of so many frames before and after each frame, and its squared length.
PAGE void codeWaves(const Plane &since, int near, const Plane &periods, const Plane &shutters,
                    const Plane &signs, int phases, const Plane &waves, const Plane &energy) {
  const int frames = since.width, clocks = waves.width, steps = clocks / periods.width;
  std::vector<double> wave(frames);
  for (int at = 0; at < clocks; at++) {
    const double period = periods.numbers()[at / steps], shutter = shutters.numbers()[at / steps];
    const double moment = double(at % steps) / phases * period;
    expose(period, -moment, shutter, since, signs, wave.data());
    double length = 0;
    for (int t = 0; t < frames; t++) {
      const int first = std::max(t - near, 0), end = std::min(t + near + 1, frames);
      double sum = 0;
      for (int other = first; other < end; other++) sum += wave[other];
      const double apart = 2 * (wave[t] - sum / (end - first));
      static_cast<float *>(waves.data)[t * clocks + at] = apart;
      length += apart * apart;
    }
    static_cast<float *>(energy.data)[at] = length;
  }
}

// Adds up the power of what parts of a display show by each clock, for each slope as in `bestSlopes`;
// `places` counts the places of each part, along x and then along y.
PAGE void slopePowers(const Plane &energy, const Plane &later, const Plane &places,
                      const Plane &axes, const Plane &powers) {
  const int sides = places.width / 2, slopes = axes.width, clocks = energy.width;
  const int phases = clocks * slopes * sides / later.width;
  const int *next = static_cast<int *>(later.data);
  for (int first = 0; first < clocks; first += phases) {
    const float *known = static_cast<float *>(energy.data) + first;
    for (int slope = 0; slope < slopes; slope++) {
      float *power = static_cast<float *>(powers.data) + slope * clocks + first;
      std::fill_n(power, phases, 1e-9f);
      for (int side = 0; side < sides; side++, next++) {
        const int part = static_cast<int *>(axes.data)[slope] * sides + side;
        const double count = static_cast<int *>(places.data)[part];
        for (int i = 0; i < phases; i++) power[i] += count * known[(i + *next) % phases];
      }
    }
  }
}

// Chooses for each of a display's clocks, as pilots/code.js numbers them, how writing goes across it.
// Parts of the display along both axes follow `along`; `later` says by how many phases each part of
// a slope is later, for each rate. Slopes must explain clearly more than those before them.
PAGE void bestSlopes(const Plane &along, const Plane &later, const Plane &powers,
                     const Plane &axes, double surer, const Plane &gain, const Plane &chosen) {
  const int sides = along.height / 2, slopes = axes.width, clocks = along.width;
  const int rates = later.width / (slopes * sides), phases = clocks / rates;
  const int *next = static_cast<int *>(later.data);
  std::vector<float> sum(phases);
  std::vector<double> explained(phases);
  for (int first = 0; first < clocks; first += phases) {
    double *__restrict most = gain.numbers() + first;
    uchar *which = static_cast<uchar *>(chosen.data) + first;
    std::fill_n(most, phases, 0.0);
    std::fill_n(which, phases, 0);
    for (int slope = 0; slope < slopes; slope++) {
      std::fill(sum.begin(), sum.end(), 0.0f);
      const int row = static_cast<int *>(axes.data)[slope] * sides;
      for (int side = 0; side < sides; side++, next++) {
        const float *values = static_cast<float *>(along.data) + (row + side) * clocks + first;
        const int left = phases - *next;
        for (int i = 0; i < left; i++) sum[i] += values[*next + i];
        for (int i = left; i < phases; i++) sum[i] += values[i - left];
      }
      const float *power = static_cast<float *>(powers.data) + slope * clocks + first;
      for (int i = 0; i < phases; i++) {
        const double positive = std::max(sum[i], 0.0f);
        explained[i] = positive * positive / power[i];
      }
      for (int i = 0; i < phases; i++) {
        if (!(explained[i] > surer * most[i])) continue;
        most[i] = explained[i];
        which[i] = slope;
      }
    }
  }
}

PAGE void equalised(const Plane &gray, const Plane &to) { equalizeHist(gray.mat(), to.mat()); }

// Takes off details that are smaller than a square: bright ones first, or dark ones.
PAGE void withoutDetails(const Plane &gray, int side, int brightFirst, const Plane &to) {
  const Mat square = Mat::ones(side, side, CV_8U);
  morphologyEx(gray.mat(), to.mat(), brightFirst ? MORPH_OPEN : MORPH_CLOSE, square);
  morphologyEx(to.mat(), to.mat(), brightFirst ? MORPH_CLOSE : MORPH_OPEN, square);
}

PAGE void stretched(const Plane &gray, double mean, double deviation, const Plane &to) {
  Scalar middle, spread;
  meanStdDev(gray.mat(), middle, spread);
  const double gain = deviation / std::max(spread[0], 1.0);
  convertScaleAbs(gray.mat(), to.mat(), gain, mean - gain * middle[0]);
}

PAGE void eroded(const Plane &mask, int side, const Plane &to) {
  erode(mask.mat(), to.mat(), Mat::ones(side, side, CV_8U), Point(-1, -1), 1, BORDER_CONSTANT,
        Scalar(255));
}

PAGE double otsu(const Plane &gray) {
  Mat unused;
  return threshold(gray.mat(), unused, 0, 255, THRESH_BINARY | THRESH_OTSU);
}

// Returns the number of points; `points` has room for the largest number that is wanted.
PAGE int features(const Plane &image, const Plane *mask, double quality, double apart,
                  const Plane &points) {
  Mat found;
  goodFeaturesToTrack(image.mat(), found, points.width / 2, quality, apart,
                      mask ? mask->mat() : Mat());
  if (found.empty()) return 0;
  found.reshape(2, found.rows).copyTo(points.points().rowRange(0, found.rows));
  return found.rows;
}

// `found` is 1 for each point that was followed; a guess of null is where the points were.
PAGE void flow(const Plane &reference, const Plane &image, const Plane &points, const Plane *guess,
               int side, int halvings, int steps, double settled, const Plane &moved,
               const Plane &found) {
  Mat there = (guess ? *guess : points).points().clone(), status;
  calcOpticalFlowPyrLK(reference.mat(), image.mat(), points.points(), there, status, noArray(),
                       Size(side, side), halvings,
                       TermCriteria(TermCriteria::COUNT + TermCriteria::EPS, steps, settled),
                       OPTFLOW_USE_INITIAL_FLOW);
  there.copyTo(moved.points());
  status.reshape(1, 1).copyTo(found.mat());
}

// Marks the points that a homography moves to within a distance of where they went, and counts them;
// stops where they cannot be more than `best` any more.
static int agreeing(const double *h, const Point2f *from, const Point2f *to, int count, double apart,
                    int best, uchar *same) {
  const float limit = float(apart * apart);
  float k[9];
  for (int i = 0; i < 9; i++) k[i] = float(h[i]);
  int found = 0;
  for (int first = 0; first < count && found + count - first > best; first += 32) {
    for (int i = first; i < std::min(count, first + 32); i++) {
      const float w = 1 / (k[6] * from[i].x + k[7] * from[i].y + k[8]);
      const float x = (k[0] * from[i].x + k[1] * from[i].y + k[2]) * w - to[i].x;
      const float y = (k[3] * from[i].x + k[4] * from[i].y + k[5]) * w - to[i].y;
      same[i] = x * x + y * y <= limit;
      found += same[i];
    }
  }
  return found;
}

// Fits a homography to the points that are marked, by least squares.
static Mat fittedTo(const Mat &marked, const Point2f *from, const Point2f *to) {
  std::vector<Point2f> before, after;
  for (int i = 0; i < marked.rows; i++) {
    if (marked.at<uchar>(i)) before.push_back(from[i]), after.push_back(to[i]);
  }
  return before.size() < 4 ? Mat() : findHomography(before, after);
}

// Moves a homography nearer to the points that are marked, by least squares (Gauss-Newton).
static Mat nearer(const Mat &H, const uchar *marked, const Point2f *from, const Point2f *to, int count) {
  double h[9];
  for (int i = 0; i < 9; i++) h[i] = H.ptr<double>()[i] / H.ptr<double>()[8];
  for (int round = 0; round < 2; round++) {
    double matrix[64] = {}, right[8] = {};
    for (int i = 0; i < count; i++) {
      if (!marked[i]) continue;
      const double x = from[i].x, y = from[i].y, w = 1 / (h[6] * x + h[7] * y + 1);
      const double u = (h[0] * x + h[1] * y + h[2]) * w, v = (h[3] * x + h[4] * y + h[5]) * w;
      const double slopes[2][8] = {{x * w, y * w, w, 0, 0, 0, -u * x * w, -u * y * w},
                                   {0, 0, 0, x * w, y * w, w, -v * x * w, -v * y * w}};
      const double left[2] = {to[i].x - u, to[i].y - v};
      for (int axis = 0; axis < 2; axis++) {
        for (int k = 0; k < 8; k++) {
          for (int m = 0; m <= k; m++) matrix[8 * k + m] += slopes[axis][k] * slopes[axis][m];
          right[k] += slopes[axis][k] * left[axis];
        }
      }
    }
    // the numbers are of very different sizes, which scales make alike
    double scale[8], move[8];
    for (int k = 0; k < 8; k++) scale[k] = 1 / std::sqrt(matrix[9 * k] + 1e-300);
    for (int k = 0; k < 8; k++) {
      right[k] *= scale[k];
      for (int m = 0; m <= k; m++) {
        matrix[8 * m + k] = matrix[8 * k + m] *= scale[k] * scale[m];
      }
    }
    Mat solved(8, 1, CV_64F, move);
    if (!solve(Mat(8, 8, CV_64F, matrix), Mat(8, 1, CV_64F, right), solved, DECOMP_CHOLESKY)) break;
    for (int k = 0; k < 8; k++) h[k] += scale[k] * move[k];
  }
  return Mat(3, 3, CV_64F, h).clone();
}

// Whether each three of four points turn the same way before and after, as where nothing is turned over.
static bool turnAlike(const Point2f *from, const Point2f *to) {
  for (int left = 0; left < 4; left++) {
    const int a = (left + 1) % 4, b = (left + 2) % 4, c = (left + 3) % 4;
    if ((from[b] - from[a]).cross(from[c] - from[a]) * (to[b] - to[a]).cross(to[c] - to[a]) <= 0)
      return false;
  }
  return true;
}

// Fits a homography by RANSAC, in so many tries at most. Each motion that more points agree with than
// before is fitted to them, whereupon still more may agree (LO-RANSAC; Chum, Matas & Kittler 2003).
// OpenCV's own takes up to eight times as long, or needs much that nothing else here does.
static Mat fittedHomography(const Mat &from, const Mat &to, double apart, int tries, Mat &agree) {
  Mat before_points, after_points;
  from.convertTo(before_points, CV_32F);
  to.convertTo(after_points, CV_32F);
  const int count = int(from.total());
  const Point2f *before = before_points.ptr<Point2f>(), *after = after_points.ptr<Point2f>();
  Mat same(count, 1, CV_8U);
  RNG random(1);
  int most = 0;
  for (int at = 0; at < tries; at++) {
    Point2f one[4], other[4];
    bool alike = false;
    for (int draw = 0; draw < 100 && !alike; draw++) {
      for (int i = 0; i < 4; i++) {
        const int picked = random.uniform(0, count);
        one[i] = before[picked], other[i] = after[picked];
      }
      alike = turnAlike(one, other);
    }
    if (!alike) break;
    Mat H = getPerspectiveTransform(one, other);
    while (!H.empty()) {
      const int found = agreeing(H.ptr<double>(), before, after, count, apart, most, same.data);
      if (found <= most) break;
      most = found;
      same.copyTo(agree);
      H = nearer(H, agree.data, before, after, count);
    }
    // as many tries as miss four points that agree once in 1000 times
    const double missed = 1 - std::pow(double(most) / count, 4);
    if (most == count || (most && at > std::log(0.001) / std::log(missed))) break;
  }
  return most < 4 ? Mat() : fittedTo(agree, before, after);
}

// Fits a motion by RANSAC, in so many tries at most. Returns the number of points that agree, 0 where
// nothing fits; `same` is 1 for each that does.
PAGE int motion(const Plane &from, const Plane &to, double apart, int affine, int tries,
                const Plane &H, const Plane &same) {
  Mat agree, fitted;
  fitted = affine ? estimateAffine2D(from.points(), to.points(), agree, RANSAC, apart, tries)
                  : fittedHomography(from.points(), to.points(), apart, tries, agree);
  if (fitted.empty()) return 0;
  Mat whole = Mat::eye(3, 3, CV_64F);
  fitted.copyTo(whole.rowRange(0, fitted.rows));
  whole.reshape(1, 1).copyTo(H.mat());
  agree.reshape(1, 1).copyTo(same.mat());
  return countNonZero(agree);
}

PAGE double hullArea(const Plane &points) {
  Mat hull;
  convexHull(points.points(), hull);
  return contourArea(hull);
}

// Writes x1, y1, x2, y2 of each straight segment, and returns their number; those are dropped for
// which there is no room.
PAGE int segments(const Plane &gray, const Plane &ends) {
  Mat found;
  createLineSegmentDetector(LSD_REFINE_STD)->detect(gray.mat(), found);
  const int count = std::min<int>(found.total(), ends.width / 4);
  if (count > 0) found.reshape(1, 1).colRange(0, 4 * count).copyTo(ends.mat().colRange(0, 4 * count));
  return count;
}

// Outlines of what is brighter than a level, of no less than an area, that four corners describe.
// Returns their number; those are dropped for which there is no room.
PAGE int brightQuads(const Plane &gray, double level, double area, const Plane &tolerances,
                     const Plane &quads) {
  Mat mask = gray.mat() > level;
  morphologyEx(mask, mask, MORPH_OPEN, Mat::ones(3, 3, CV_8U));
  std::vector<std::vector<Point>> outlines;
  findContours(mask, outlines, RETR_LIST, CHAIN_APPROX_SIMPLE);
  Point2d *next = static_cast<Point2d *>(quads.data), *const end = next + quads.width / 2;
  for (const auto &outline : outlines) {
    if (contourArea(outline) < area || next == end) continue;
    std::vector<Point> hull, corners;
    convexHull(outline, hull);
    for (int i = 0; i < tolerances.width && corners.size() != 4; i++) {
      approxPolyDP(hull, corners, tolerances.numbers()[i] * arcLength(hull, true), true);
    }
    if (corners.size() == 4) next = std::copy(corners.begin(), corners.end(), next);
  }
  return (next - static_cast<Point2d *>(quads.data)) / 4;
}

// Correlates each part of maps, less the mean around each pixel, with what is expected there, for all
// shifts within a reach: maps have a row each, and so have matches. Blocks that are expected not to
// change add nothing, and of the others a sum over pixels is enough; so this takes a tenth of the time
// of matchTemplate, which finds the same.
PAGE void matchParts(const Plane &maps, int width, int aroundX, int aroundY, const Plane &blocks,
                     const Plane &ys, const Plane &xs, int reachX, int reachY,
                     const Plane &matches) {
  const int wide = 2 * reachX + 1, high = 2 * reachY + 1, height = maps.width / width;
  const auto start = [](int block, int length, int count) {
    return (block * length + count - 1) / count;
  };
  const int *y = ys.whole(), *x = xs.whole();
  float *match = static_cast<float *>(matches.data);
  std::fill_n(match, matches.width * matches.height, 0.f);
  Mat flat(height, width, CV_32F), around, sums;
  for (int map = 0; map < maps.height; map++) {
    takeMeanAround(maps.mat().row(map).reshape(1, height), Size(aroundX, aroundY), Mat(flat));
    copyMakeBorder(flat, around, reachY, reachY, reachX, reachX, BORDER_CONSTANT);
    integral(around, sums, CV_64F);
    for (int i = 0; i + 1 < ys.width; i++) {
      for (int k = 0; k + 1 < xs.width; k++, match += wide * high) {
        for (int block = 0; block < blocks.width * blocks.height; block++) {
          const int row = block / blocks.width, col = block % blocks.width;
          const float value = static_cast<float *>(blocks.data)[block];
          const int top = std::max(y[i], start(row, height, blocks.height));
          const int left = std::max(x[k], start(col, width, blocks.width));
          const int bottom = std::min(y[i + 1], start(row + 1, height, blocks.height));
          const int right = std::min(x[k + 1], start(col + 1, width, blocks.width));
          if (value == 0 || top >= bottom || left >= right) continue;
          for (int dy = 0; dy < high; dy++) {
            const double *above = sums.ptr<double>(top + dy), *below = sums.ptr<double>(bottom + dy);
            float *to = match + dy * wide;
            for (int dx = 0; dx < wide; dx++) {
              to[dx] += value * float(below[right + dx] - below[left + dx] - above[right + dx] +
                                      above[left + dx]);
            }
          }
        }
      }
    }
  }
}
