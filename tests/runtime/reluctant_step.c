/* Put into ldsim.c before ldsim_step: its next tries end as they are told. */
static const int *told_reasons, *told_away;
static int told;

void ldsim_tell(int count, const int *reasons, const int *away)
{
    told = count, told_reasons = reasons, told_away = away;
}

static solution reluctant(ldsim_solid *S, const moment *from, moment *to)
{
    solution found = try_step(S, from, to);
    if (told == 0) return found;
    found.reason = (ldsim_reason)*told_reasons++;
    if (*told_away++) to->f[0] = 1e9;
    told--;
    return found;
}

#define try_step reluctant
