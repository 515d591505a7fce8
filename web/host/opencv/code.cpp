// Long sums of web/port/link/code, as plain functions of WebAssembly. A browser runs JavaScript slowly
// until it has compiled it, and a message is decoded only once.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include "plane.h"

// Whether sums of bits, which are 1 where what they are told is below 1, are all even.
static bool allEven(const Plane &starts, const Plane &members, const double *total) {
  for (int sum = 0; sum + 1 < starts.width; sum++) {
    bool odd = false;
    for (int edge = starts.whole()[sum]; edge < starts.whole()[sum + 1]; edge++) {
      odd ^= total[members.whole()[edge]] < 1;
    }
    if (odd) return false;
  }
  return true;
}

// Does rounds of belief propagation (propagation.js says what the numbers are), until the bits
// satisfy the checks; tells whether they do. No sum tells anything of the bit `missing`, which does
// not exist. Where there is one, every other bit must have been told something, too.
PAGE int propagated(const Plane &starts, const Plane &members, const Plane &sumTanh,
                    const Plane &known, const Plane &checkStarts, const Plane &checkMembers,
                    double leastTanh, double mostTanh, double mostProduct, double mostTotal,
                    int missing, int rounds, const Plane &messagesBefore, const Plane &totalBefore,
                    const Plane &messages, const Plane &total) {
  const int *member = members.whole(), bits = known.width;
  double *message = messages.numbers(), *told = total.numbers();
  std::copy_n(messagesBefore.numbers(), members.width, message);
  std::copy_n(totalBefore.numbers(), bits, told);
  std::vector<double> next(bits), tanhs;
  for (int round = 0; round < rounds; round++) {
    std::copy_n(known.numbers(), bits, next.begin());
    for (int sum = 0; sum < sumTanh.width; sum++) {
      const int first = starts.whole()[sum], end = starts.whole()[sum + 1];
      tanhs.resize(end - first);
      // each message is the product of all others: of those before it and those after it
      double product = sumTanh.numbers()[sum];
      for (int edge = first; edge < end; edge++) {
        const double all = told[member[edge]], mine = message[edge];
        double tanh = std::clamp((all - mine) / (all + mine), -mostTanh, mostTanh);
        if (std::abs(tanh) < leastTanh) tanh = tanh > 0 ? leastTanh : -leastTanh;
        tanhs[edge - first] = tanh;
        message[edge] = product;
        product *= tanh;
      }
      product = 1;
      for (int edge = end - 1; edge >= first; edge--) {
        const double mine = std::clamp(message[edge] * product, -mostProduct, mostProduct);
        product *= tanhs[edge - first];
        message[edge] = (1 + mine) / (1 - mine);
        double &grown = next[member[edge]];
        grown = std::clamp(grown * message[edge], 1 / mostTotal, mostTotal);
      }
    }
    std::copy(next.begin(), next.end(), told);
    if (missing >= 0) told[missing] = known.numbers()[missing];
    const bool isTold = missing < 0 || std::find(told, told + bits, 1.0) == told + bits;
    if (isTold && allEven(checkStarts, checkMembers, told)) return 1;
  }
  return 0;
}

// A pseudo-random word (scrambled.js).
static uint64_t scrambled(uint64_t number, uint64_t seed) {
  uint64_t state = number + (seed + 1) * 0x9e3779b97f4a7c15;
  state = (state ^ state >> 30) * 0xbf58476d1ce4e5b9;
  state = (state ^ state >> 27) * 0x94d049bb133111eb;
  return state ^ state >> 31;
}

// Guesses the terms of a short message (likelyTerms.js, link/code/likely_terms.py). Evidence has a
// row for each of the six words. The rows of `usual` are, by length of the message, the number that
// the fourth word tells, the upper bits of the fifth, and the check of length and frames;
// `markChecks` has what each bit of the mark changes in the check, the lowest bit first. Writes mark
// and place of the length, and tells whether they are believed.
PAGE int likelyTerms(const Plane &evidence, const Plane &usual, const Plane &markChecks,
                     double openTerms, double doubt, int mostMarks, const Plane &found) {
  struct Marked {
    int mark;
    double score;
  };
  const int numbers = evidence.width, shift = std::lround(std::log2(numbers));
  const double needed = openTerms - std::log(doubt);
  cv::Mat likelihoods;
  evidence.mat().convertTo(likelihoods, CV_64F);
  double *words[6], most[6];
  for (int word = 0; word < 6; word++) {
    double *row = words[word] = likelihoods.ptr<double>(word);
    const double largest = *std::max_element(row, row + numbers);
    double sum = 0;
    for (int number = 0; number < numbers; number++) sum += std::exp(row[number] - largest);
    const double chance = largest + std::log(sum / numbers);
    for (int number = 0; number < numbers; number++) row[number] -= chance;
    most[word] = largest - chance;
  }
  const double later = most[3] + most[4] + most[5];
  if (most[0] + most[1] + most[2] + later < needed) return 0;
  std::vector<int> order[2];
  for (int word = 0; word < 2; word++) {
    order[word].resize(numbers);
    std::iota(order[word].begin(), order[word].end(), 0);
    std::stable_sort(order[word].begin(), order[word].end(),
                     [row = words[word]](int one, int other) { return row[one] > row[other]; });
  }
  const auto mask = [numbers](int piece, int mark) { return scrambled(piece, mark) % numbers; };
  std::vector<Marked> marks;
  for (int rank = 0; rank < numbers; rank++) {
    // a pair of the ranks a and b, counted from 0, has (a + 1) (b + 1) - 1 that are no worse
    for (int at = 0; at < numbers / (rank + 1); at++) {
      const int high = order[0][rank], low = order[1][at], mark = high << shift | low;
      const double told = words[0][high] + words[1][low];
      if (told + most[2] + later < needed) break;
      const double score = told + words[2][mask(2, mark)]; // which all short lengths share
      if (score + later >= needed) marks.push_back({mark, score});
    }
  }
  std::stable_sort(marks.begin(), marks.end(),
                   [](const Marked &one, const Marked &other) { return one.score > other.score; });
  if (marks.size() > static_cast<size_t>(mostMarks)) marks.resize(mostMarks);
  const double negligible = 40; // terms that are so much less likely do not count, even if many
  double best = -INFINITY;
  std::vector<double> totals;
  for (const auto &[mark, score] : marks) {
    int markCheck = 0;
    for (int bit = 0; bit < markChecks.width; bit++) {
      if (mark >> bit & 1) markCheck ^= markChecks.whole()[bit]; // a CRC is linear
    }
    const int masks[] = {int(mask(3, mark)), int(mask(4, mark)), int(mask(5, mark))};
    for (int length = 0; length < usual.width; length++) {
      const int *column = usual.whole() + length;
      const int check = column[2 * usual.width] ^ markCheck;
      const double total = score + words[3][column[0] ^ masks[0]] +
                           words[4][(column[usual.width] | check >> shift) ^ masks[1]] +
                           words[5][(check & (numbers - 1)) ^ masks[2]];
      if (total > best - negligible) totals.push_back(total);
      if (total <= best) continue;
      best = total;
      found.numbers()[0] = mark;
      found.numbers()[1] = length;
    }
  }
  double others = std::exp(openTerms - best) - 1;
  for (const double total : totals) others += std::exp(total - best);
  return others <= doubt;
}
